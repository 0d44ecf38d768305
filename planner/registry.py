"""The planners by name, as the command line and study files know them."""

from dataclasses import fields
from typing import Any

from .errors import PlannerError
from .expected_improvement import ExpectedImprovement
from .find_and_outline.planner import FindAndOutline
from .multi_resolution import MultiResolution
from .planner import Planner
from .random_order import RandomOrder

_PLANNERS: dict[str, type[Any]] = {
    "expected-improvement": ExpectedImprovement,
    "find-and-outline": FindAndOutline,
    "random": RandomOrder,
    "multi-resolution": MultiResolution,
}


def planner_names() -> tuple[str, ...]:
    """The names of all planners; the paper's own comes first."""
    return tuple(_PLANNERS)


def make_planner(name: str, **options: Any) -> Planner:
    """The planner of that name.

    Args:
        name: One of `planner_names()`.
        options: Fields of the planner's class; those left out keep their defaults.

    Raises:
        PlannerError: If a name or an option is unknown (the text lists what exists) or a value out of range.
    """
    if name not in _PLANNERS:
        raise PlannerError(f"there is no planner {name!r}; choose one of {', '.join(_PLANNERS)}")
    planner_class = _PLANNERS[name]
    known = [field.name for field in fields(planner_class)]
    unknown = [option for option in options if option not in known]
    if unknown:
        raise PlannerError(
            f"planner {name!r} has no option {unknown[0]!r}; it has {', '.join(known) if known else 'none'}"
        )
    return planner_class(**options)

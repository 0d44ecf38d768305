"""The planners by name, as the command line and study files know them."""

from dataclasses import fields
from typing import Any

from .baselines import (
    ExpectedVolume,
    GreedyCoverage,
    MutualInformation,
    ProbabilityOfImprovement,
    ThompsonSampling,
    UpperConfidenceBound,
)
from .errors import PlannerError
from .expected_improvement import ExpectedImprovement
from .find_and_outline.planner import FindAndOutline
from .multi_resolution import MultiResolution
from .paths.a_star import AStar
from .paths.boustrophedon import Boustrophedon
from .paths.ergodic import Ergodic
from .paths.find_and_outline_paths import FindAndOutlinePaths
from .planner import Planner
from .random_order import RandomOrder
from .trained import Trained

_PLANNERS: dict[str, type[Any]] = {
    "expected-improvement": ExpectedImprovement,
    "find-and-outline": FindAndOutline,
    "random": RandomOrder,
    "multi-resolution": MultiResolution,
    "upper-confidence-bound": UpperConfidenceBound,
    "probability-of-improvement": ProbabilityOfImprovement,
    "thompson-sampling": ThompsonSampling,
    "mutual-information": MutualInformation,
    "expected-volume": ExpectedVolume,
    "greedy-coverage": GreedyCoverage,
    "trained": Trained,
    "find-and-outline-paths": FindAndOutlinePaths,
    "boustrophedon": Boustrophedon,
    "ergodic": Ergodic,
    "a-star": AStar,
}


def planner_names() -> tuple[str, ...]:
    """The names of all planners; the paper's own is the first."""
    return tuple(_PLANNERS)


def confident_planner_names() -> tuple[str, ...]:
    """The names of the planners that tell how sure they are that nothing is left."""
    return tuple(name for name, made in _PLANNERS.items() if made.confidence is not Planner.confidence)


def weighing_planner_names() -> tuple[str, ...]:
    """The names of the planners that tell when to go on is not worth the actions."""
    return tuple(
        name for name, made in _PLANNERS.items() if made.is_worth_going_on is not Planner.is_worth_going_on
    )


def planner_class(name: str) -> type[Planner]:
    """The class of the planner of that name.

    Args:
        name: One of `planner_names()`.

    Raises:
        PlannerError: If there is no such planner; the text lists those that exist.
    """
    if name not in _PLANNERS:
        raise PlannerError(f"there is no planner {name!r}; choose one of {', '.join(_PLANNERS)}")
    return _PLANNERS[name]


def make_planner(name: str, **options: Any) -> Planner:
    """The planner of that name.

    Args:
        name: One of `planner_names()`.
        options: Fields of the planner's class; those left out keep their defaults.

    Raises:
        PlannerError: If a name or an option is unknown (the text lists what exists) or a value is out of range.
    """
    made: type[Any] = planner_class(name)
    known = [field.name for field in fields(made)]
    unknown = [option for option in options if option not in known]
    if unknown:
        raise PlannerError(
            f"planner {name!r} has no option {unknown[0]!r}; it has {', '.join(known) if known else 'none'}"
        )
    return made(**options)

"""The limit that a bound's folder tells of, beside which planners and single runs are shown."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.storage import replacing
from sim.campaign.study import SETUP_OPTIONS, parse_seeds
from sim.errors import FieldError, UsageError
from sim.running.fields import default_of
from sim.running.placing.body import NOT_AS_PLANNED

from .folder import read_bound, read_seed
from .policy import PolicyBound
from .policy_study import bound_of
from .summary import fewest_of

SUMMARY, LIMIT = "summary.json", "limit"
"""The file that keeps the limit of a run, and its key there."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Limit:
    """What no planner can undercut in one case."""

    case: Mapping[str, Any]
    """Options that make the case, as a trial's settings have them."""
    fewest: Mapping[int, int | None]
    """The proven hindsight optimum of each seed; None where no poses are enough."""
    policy: PolicyBound | None
    """The bound on every policy; None where none was asked for or can be proven."""

    def in_hindsight(self, seeds: Sequence[int] | NDArray[np.int64]) -> NDArray[np.float64]:
        """The hindsight optimum of seeds, shape (n,): infinite where no poses are enough, NaN where it is not known."""
        known = {seed: np.inf if each is None else float(each) for seed, each in self.fewest.items()}
        return np.array([known.get(int(seed), np.nan) for seed in seeds])

    def least_mean(self, horizon: float) -> float | None:
        """The least mean number of actions of any policy with tumours as the scenario plants them; None for no bound.

        Args:
            horizon: Actions beyond which an episode counts with that number; infinite for none.
        """
        if self.policy is None:
            return None
        return self.policy.least_mean(is_apart=True, horizon=horizon)


def load_limit(path: Path) -> Limit:
    """The limit that a folder of `sounding bound` holds.

    Raises:
        UsageError: The folder holds no bound that is finished.
    """
    content = read_bound(path)
    if content.get("status") != "finished":
        raise UsageError(f"{path}: is not finished. Run `sounding bound` with the same options to its end.")
    seeds = parse_seeds(content["seeds"])
    fewest = fewest_of([read_seed(path, seed) for seed in seeds])
    policy = content["policy"]
    return Limit(
        case=content["case"],
        fewest=dict(zip(seeds, fewest, strict=True)),
        policy=None if policy is None else bound_of(policy, fewest),
    )


_AS_COUNTED = ("motion", "sense", *NOT_AS_PLANNED)
"""Options by which an action is another than those that a bound counts: a sweep reads on the way, and servos, a body
that moves or yields and a tip that is measured wrong put the cone elsewhere."""


def limit_of_run(bounds: Sequence[Path], options: Mapping[str, Any]) -> dict[str, Any] | None:
    """What the first bound of a run's case says of the run; None where none is of its case.

    Args:
        bounds: Folders that `sounding bound` wrote.
        options: The run's options, as its config.json has them.

    Returns:
        `in_hindsight`, the fewest poses that are enough for the run's seed, None where it is not known or no poses are
        enough; `is_possible`, whether some poses are enough, None where that is not known; and `least_mean`, the least
        mean number of actions of any policy over all seeds, None where none is proven.

    Raises:
        UsageError: A folder holds no bound that is finished.
    """
    for folder in bounds:
        limit = load_limit(folder)
        if not _is_of_case(read_bound(folder), options):
            continue
        seed = int(options["seed"])
        return {
            "in_hindsight": limit.fewest.get(seed),
            "is_possible": limit.fewest[seed] is not None if seed in limit.fewest else None,
            "least_mean": limit.least_mean(math.inf),
        }
    return None


def keep_limit(folder: Path, bounds: Sequence[Path]) -> None:
    """Keep the limit of a run in its summary.json, which its report and account then tell of.

    Args:
        folder: The run's folder.
        bounds: Folders that `sounding bound` wrote.

    Raises:
        UsageError: The run has no summary yet, or no bound is of its case or none is finished.
    """
    try:
        options = json.loads((folder / "config.json").read_text(encoding="utf-8"))["options"]
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError, KeyError) as error:
        raise UsageError(f"{folder}: holds no run of `sounding episode` that came to its end.") from error
    limit = limit_of_run(bounds, options)
    if limit is None:
        raise FieldError("bound", ", ".join(map(str, bounds)), other_case(folder, options))
    with replacing(folder / SUMMARY) as file:
        file.write((json.dumps({**summary, LIMIT: limit}, indent=2, allow_nan=False) + "\n").encode())


def other_case(folder: Path, options: Mapping[str, Any]) -> str:
    """Why bounds that do not hold of a run are refused, and what to do where something can be done."""
    if (other := not_counted(options)) is not None:
        return f"does not hold of {folder}: {other}"
    return (
        f"is not of the case of {folder} ({options['scenario']}, arm {options['arm']}). Run `sounding bound` with the "
        "scenario and the arm of the run."
    )


def not_counted(options: Mapping[str, Any]) -> str | None:
    """Why the actions of a run are not those that a bound counts, as a sentence; None where they are.

    Args:
        options: The run's options, or a trial's settings; an option that is missing has its default.
    """
    for name in _AS_COUNTED:
        value = options.get(name, default_of(name))
        if value == "servo" or (name != "motion" and value != default_of(name)):
            return (
                "a bound counts actions that hold one cone each, at a planned pose of the organ as it was planned, and "
                f"it ran with {name.replace('_', '-')} {value}."
            )
    return None


def _is_of_case(bound: Mapping[str, Any], options: Mapping[str, Any]) -> bool:
    """Whether a bound is of the organ, the tumours and the arm of a run whose actions are those that it counts."""
    asked = {**bound["case"], **bound["options"]}
    return not_counted(options) is None and all(
        asked.get(name, default_of(name)) == options.get(name, default_of(name)) for name in SETUP_OPTIONS
    )

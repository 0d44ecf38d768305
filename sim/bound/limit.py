"""The limit that a bound's folder tells of, beside which planners are shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.campaign.study import parse_seeds
from sim.errors import UsageError

from .folder import read_bound, read_seed
from .policy import PolicyBound
from .policy_study import bound_of
from .summary import fewest_of


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

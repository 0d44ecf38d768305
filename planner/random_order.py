"""The random baseline: poses drawn uniformly, none twice."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from .planner import Planner
from .situation import Situation


@dataclass(frozen=True)
class RandomOrder(Planner):
    """Poses in an order drawn uniformly from all orders of those that are left, none twice."""

    preferred_map: ClassVar[Literal["paper", "calibrated"]] = "paper"
    needs_belief: ClassVar[bool] = False

    def rank(self, situation: Situation) -> Iterator[int]:
        """Every pose neither sensed nor skipped, in uniformly random order; see `Planner.rank`."""
        return random_order(situation)


def random_order(situation: Situation) -> Iterator[int]:
    """Every pose neither sensed nor skipped, in an order drawn from the situation's generator."""
    remaining = np.flatnonzero(situation.available(exclude_sensed=True))
    # Lazily, since the caller takes few of them.
    yield from map(int, situation.rng.permutation(remaining))

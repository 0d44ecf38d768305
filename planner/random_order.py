"""The random baseline: poses drawn uniformly, none twice."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from .planner import Planner
from .situation import Situation


@dataclass(frozen=True)
class RandomOrder(Planner):
    """Senses in an order drawn uniformly from all orders of the workspace's poses, without replacement."""

    preferred_map: ClassVar[Literal["paper", "calibrated"]] = "paper"
    needs_belief: ClassVar[bool] = False

    def rank(self, situation: Situation) -> Iterator[int]:
        """Every pose neither sensed nor skipped, in uniformly random order."""
        return random_order(situation)


def random_order(situation: Situation) -> Iterator[int]:
    """Every pose neither sensed nor skipped, in an order drawn from the situation's generator."""
    remaining = np.flatnonzero(situation.available(exclude_sensed=True))
    yield from map(int, situation.rng.permutation(remaining))  # lazily: few are asked for

"""A planner of paths over the surface, which ranks poses too: the ends of its paths, and then all others."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator

import numpy as np

from ..planner import Planner
from ..situation import Situation


class PathPlanner(Planner):
    """A planner that thinks in paths. Where the probe is lifted after each reading it goes to the ends of its paths."""

    @abstractmethod
    def paths(self, situation: Situation) -> Iterator[tuple[int, ...]]:
        """See `Planner.paths`."""

    def rank(self, situation: Situation) -> Iterator[int]:
        """See `Planner.rank`."""
        is_left = situation.available(exclude_sensed=True)
        for path in self.paths(situation):
            if is_left[path[-1]]:
                is_left[path[-1]] = False
                yield path[-1]
        yield from map(int, np.flatnonzero(is_left))

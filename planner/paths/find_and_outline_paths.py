"""Find-and-outline over paths: the probe goes where it newly sees most in a second, and looks on the way.

An orienteering problem (Golden, Levy and Vohra, Naval Research Logistics 34, 1987) with a value that is submodular:
what a path sees is the union of what its readings see. It is solved greedily, and anew after each path.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import PlannerError
from ..find_and_outline.fine_lattice import fine_lattice, likely_m3
from ..find_and_outline.hidden_balls import hidden_balls
from ..find_and_outline.planner import FindAndOutline
from ..situation import Situation
from ..visibility import visibility
from .roadmap import Roadmap, Ways, along_m, read_at

_GAP_M = 0.012
"""The best pose of each cube of this side is the end of a candidate path [m]."""
_N_CANDIDATES = 120
"""Candidate paths at most, those to the poses of highest score."""


@dataclass(frozen=True, kw_only=True)
class FindAndOutlinePaths(FindAndOutline):
    """Ranks paths by the tumour volume that their readings are expected to newly see in a second.

        merit = (V share of balls that some reading finds + outline that some reading sees) / (seconds + `overhead_s`)

    with V, balls and outline as `FindAndOutline` has them. As a planner of poses it is find-and-outline.
    """

    needs_belief: ClassVar[bool] = True

    overhead_s: float = 0.0
    """Time that a path costs beside that of its way [s]: the larger, the longer the paths."""

    def __post_init__(self) -> None:
        """Checks the ranges."""
        super().__post_init__()
        if not 0.0 <= self.overhead_s < np.inf:
            raise PlannerError(f"`overhead_s` must be 0 or above and finite, got {self.overhead_s}")

    def paths(self, situation: Situation) -> Iterator[tuple[int, ...]]:
        """The best paths to poses within reach of a slide, best first, then the poses of the ranking.

        See `Planner.paths`.
        """
        if situation.roadmap is not None and situation.sensed:
            yield from ((end,) for end in self._ends(situation, situation.roadmap))
        yield from super().paths(situation)

    def _ends(self, situation: Situation, roadmap: Roadmap) -> list[int]:
        """The ends of the candidate paths with some merit, best first."""
        ways = roadmap.ways_from(situation.sensed[-1])
        score = self.score(situation)
        score[~(situation.available(exclude_sensed=True) & np.isfinite(ways.lengths_m))] = 0.0
        ends = situation.workspace.best_apart(score, _GAP_M)[:_N_CANDIDATES]
        if not len(ends):
            return []
        seen = [_read_on(situation, ways, int(end)) for end in ends]
        gains = self._gains(situation, seen)
        seconds = ways.lengths_m[ends] / situation.sweep_speed_m_s
        merit = gains / np.maximum(seconds + self.overhead_s, 1e-6)
        order = np.argsort(-merit, kind="stable")
        return [int(ends[i]) for i in order if merit[i] > 0.0]

    def _hidden_m3(self, situation: Situation) -> float:
        """The tumour volume that a search of the whole organ is expected to find [m^3]."""
        if not self._is_worth_searching(situation):
            return 0.0
        return self.hidden_m3 + self.hidden_ratio * likely_m3(situation)

    def _gains(self, situation: Situation, seen: list[NDArray[np.intp]]) -> NDArray[np.float64]:
        """The tumour volume that the readings of each path are expected to newly see [m^3], shape (k,).

        Args:
            situation: What is known so far.
            seen: The poses at which each path reads.
        """
        poses, place = np.unique(np.concatenate(seen), return_inverse=True)
        starts = np.concatenate([[0], np.cumsum([len(each) for each in seen])])[:-1]
        workspace, points_m = situation.workspace, situation.search_points_m
        balls = hidden_balls(workspace, situation.cone, points_m, situation.surface_distance_m, self.balls)
        fading = max(self.fading, situation.missed_rate)
        left = balls.weights * fading ** balls.times_found(situation.sensed)
        finds = balls.finds[poses].toarray() > 0.0
        found = np.logical_or.reduceat(finds[place.ravel()], starts, axis=0) @ left
        gains = self._hidden_m3(situation) * found.astype(np.float64)
        open_m, weights = self.open_points(situation)
        if len(open_m):
            cell_m3 = fine_lattice(situation.search_points_m).cell_m3
            sees = visibility(workspace.part(poses), situation.cone, open_m).T
            outlined_m3 = cell_m3 * (np.logical_or.reduceat(sees[place.ravel()], starts, axis=0) @ weights)
            gains += np.where(outlined_m3 >= self.least_gain_m3, outlined_m3, 0.0)
        return gains


def _read_on(situation: Situation, ways: Ways, end: int) -> NDArray[np.intp]:
    """The poses at which a path to one reads."""
    way = ways.to(end)
    rows = read_at(along_m(situation.workspace, way), situation.read_every_m)
    return np.array(way, dtype=np.intp)[rows] if len(rows) else np.array([end], dtype=np.intp)

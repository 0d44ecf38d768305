"""Paths by graph search: the planner of Cho and Kuntz, as far as the abstract of their paper tells.

Efficient and accurate mapping of subsurface anatomy via online trajectory optimization for robot assisted surgery, ICRA
2024 (arXiv 2309.10154). It says that paths over the surface are planned on the map by a graph search, A*, whose cost
balances the exploration of what was not sensed with the refinement of what is known. Which goal, which weights and
which heuristic it takes is open to us, and there is no public code: the choices below are ours.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import PlannerError
from ..situation import Situation
from .path_planner import PathPlanner
from .roadmap import Roadmap
from .worth import explored_and_refined

_N_GOALS = 20
"""Goals to which paths are sought, best first, where a path cannot be taken; then poses are tried without one."""


@dataclass(frozen=True, kw_only=True)
class AStar(PathPlanner):
    """Goes to the pose of highest worth, by the path on which dear stretches are those that see nothing new.

    worth = explore explored + (1 - explore) refined,   cost of an edge = length (1 + detour (1 - worth of its end))
    """

    needs_belief: ClassVar[bool] = True

    explore: float = 0.5
    """Weight of what was never sensed against what is doubtful."""
    detour: float = 4.0
    """How much dearer a stretch is that sees nothing new."""
    goal_gap_m: float = 0.03
    """Goals are the best poses of cubes of this side [m]."""

    def __post_init__(self) -> None:
        """Checks the ranges."""
        if not 0.0 <= self.explore <= 1.0:
            raise PlannerError(f"`explore` must lie in 0 .. 1, got {self.explore}")
        if not 0.0 <= self.detour < np.inf:
            raise PlannerError(f"`detour` must be 0 or above and finite, got {self.detour}")
        if not 0.0 < self.goal_gap_m < np.inf:
            raise PlannerError(f"`goal_gap_m` must be above 0 and finite, got {self.goal_gap_m}")

    def paths(self, situation: Situation) -> Iterator[tuple[int, ...]]:
        """The cheapest path to the best goal, those to the next, then all poses by worth. See `Planner.paths`."""
        roadmap = situation.roadmap or Roadmap.of_surface(situation.workspace)
        explored, refined = explored_and_refined(situation, "a-star")
        worth = self.explore * explored + (1.0 - self.explore) * refined
        is_open = situation.available(exclude_sensed=True)
        goals = situation.workspace.best_apart(np.where(is_open, worth, 0.0), self.goal_gap_m)
        for goal in goals[:_N_GOALS].tolist():
            path = ()
            if situation.sensed and situation.sensed[-1] != goal:
                path = cheapest_path(roadmap, situation.sensed[-1], goal, self.detour * (1.0 - worth))
            yield path[1:] if len(path) > 1 else (goal,)
        for pose in np.argsort(-worth, kind="stable"):
            if is_open[pose]:
                yield (int(pose),)


def cheapest_path(roadmap: Roadmap, start: int, goal: int, dearness: NDArray[np.float64]) -> tuple[int, ...]:
    """The path of least cost by A* (Hart, Nilsson and Raphael, 1968), both ends among it; empty where there is none.

    The cost of an edge is its length times 1 + the dearness of the pose that it leads to. The straight distance to the
    goal never exceeds what is left, so that the path is the cheapest.

    Args:
        roadmap: The poses and edges.
        start: Where the path begins.
        goal: Where it ends.
        dearness: Dearness of each pose, 0 or above, shape (N,).
    """
    graph, places_m = roadmap.graph, roadmap.workspace.positions_m
    left_m = np.linalg.norm(places_m - places_m[goal], axis=1)
    cost, before, done = {start: 0.0}, {start: start}, set[int]()
    front = [(float(left_m[start]), start)]
    while front:
        _, here = heapq.heappop(front)
        if here == goal:
            way = [goal]
            while way[-1] != start:
                way.append(before[way[-1]])
            return tuple(reversed(way))
        if here in done:
            continue
        done.add(here)
        row = slice(graph.indptr[here], graph.indptr[here + 1])
        dear = graph.data[row] * (1.0 + dearness[graph.indices[row]])
        for other, step in zip(graph.indices[row].tolist(), dear.tolist(), strict=True):
            if cost[here] + step < cost.get(other, np.inf):
                cost[other], before[other] = cost[here] + step, here
                heapq.heappush(front, (cost[other] + float(left_m[other]), other))
    return ()

"""Ergodic search on the surface: the probe is drawn to where it was less than what is to be seen there deserves.

The area coverage driven by a heat equation (HEDAC) of Ivic, Crnkovic and Mezic, Ergodicity-based cooperative multiagent
area coverage via a potential field, IEEE Transactions on Cybernetics 47(8), 2017, with the graph of the roadmap in the
place of a plane. On curved surfaces it is used by Bilaloglu, Loew and Calinon, Tactile ergodic coverage on curved
surfaces, arXiv 2402.04862, 2024.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

from ..errors import PlannerError
from ..situation import Situation
from .path_planner import PathPlanner
from .roadmap import Roadmap
from .worth import explored_and_refined


@dataclass(frozen=True, kw_only=True)
class Ergodic(PathPlanner):
    """Follows the gradient of a potential u that solves a steady heat equation on the surface.

        (1 / reach_m^2 - laplacian) u = max(p - c, 0)^2

    p is the density of what is worth seeing, the sum of what was never sensed and of what is doubtful as the poses see
    it. c is that of past readings, a Gaussian for each. Both add up to 1.
    """

    preferred_map: ClassVar[Any] = "calibrated"
    needs_belief: ClassVar[bool] = True

    reach_m: float = 0.05
    """How far the potential carries over the surface [m]."""
    footprint_share: float = 0.5
    """Standard deviation of a reading's Gaussian, as a share of the radius of the cone's base."""
    stretch_m: float = 0.06
    """Longest way before the map is looked at again [m]."""

    def __post_init__(self) -> None:
        """Checks the ranges."""
        for name in ("reach_m", "footprint_share", "stretch_m"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise PlannerError(f"`{name}` must be above 0 and finite, got {getattr(self, name)}")

    def paths(self, situation: Situation) -> Iterator[tuple[int, ...]]:
        """The way up the potential, then all places, those where it is highest first. See `Planner.paths`."""
        roadmap = situation.roadmap or Roadmap.of_surface(situation.workspace)
        is_open = situation.available(exclude_sensed=True)
        potential = self._potential(situation, roadmap)
        if situation.sensed:
            climbed = self._climbed(roadmap, potential, situation.sensed[-1])
            if climbed and is_open[climbed[-1]]:
                yield climbed
        for pose in np.argsort(-potential, kind="stable"):
            if is_open[pose]:
                yield (int(pose),)

    def _climbed(self, roadmap: Roadmap, potential: NDArray[np.float64], start: int) -> tuple[int, ...]:
        """The steepest way up from a pose, to a summit or for a stretch; empty on a summit."""
        graph, way, gone_m = roadmap.graph, [start], 0.0
        while gone_m < self.stretch_m:
            row = slice(graph.indptr[way[-1]], graph.indptr[way[-1] + 1])
            others, lengths_m = graph.indices[row], graph.data[row]
            if not len(others):
                break
            slope = (potential[others] - potential[way[-1]]) / lengths_m
            best = int(np.argmax(slope))
            if slope[best] <= 0.0:
                break
            way.append(int(others[best]))
            gone_m += float(lengths_m[best])
        return tuple(way[1:])

    def _potential(self, situation: Situation, roadmap: Roadmap) -> NDArray[np.float64]:
        """The potential u at each pose, shape (N,)."""
        explored, refined = explored_and_refined(situation, "ergodic")
        wanted = explored + refined
        wanted = wanted / wanted.sum() if wanted.sum() > 0.0 else np.full(len(wanted), 1.0 / len(wanted))
        had = self._covered(situation)
        source = np.maximum(wanted - had, 0.0) ** 2
        return _solver(roadmap, self.reach_m)(source / max(float(source.max()), 1e-300))

    def _covered(self, situation: Situation) -> NDArray[np.float64]:
        """The density of past readings at each pose, shape (N,)."""
        places_m = situation.workspace.positions_m
        covered = np.zeros(len(places_m))
        width_m = self.footprint_share * situation.cone.base_radius_m
        tree = KDTree(places_m)
        for pose in situation.sensed:
            near = tree.query_ball_point(places_m[pose], 3.0 * width_m)
            away = np.linalg.norm(places_m[near] - places_m[pose], axis=1) / width_m
            covered[near] += np.exp(-(away**2) / 2.0)
        return covered / max(float(covered.sum()), 1e-300)


@lru_cache(maxsize=4)
def _solver(roadmap: Roadmap, reach_m: float) -> Any:
    """What solves the equation on a roadmap, factorised once.

    The Laplacian has the weight 4 / (degree l^2) for an edge of length l, which on an even grid is the plane's.
    """
    from scipy.sparse.linalg import splu

    graph, n = roadmap.graph.tocoo(), roadmap.workspace.n_poses
    degree = np.maximum(np.bincount(graph.row, minlength=n), 1)
    mean_degree = (degree[graph.row] + degree[graph.col]) / 2.0
    weights = sparse.coo_matrix((4.0 / (mean_degree * graph.data**2), (graph.row, graph.col)), (n, n))
    total = np.asarray(weights.sum(axis=1)).ravel()
    matrix = sparse.diags(total + 1.0 / reach_m**2) - weights
    return splu(matrix.tocsc()).solve

"""The roadmap: which neighbouring poses the probe glides between, and the shortest ways over the surface on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree

from ..errors import PlannerError
from ..workspace import Workspace

_N_NEIGHBOURS = 20
"""Nearest poses that are looked at: on a square grid all moves within two squares, the knight's among them. No way
is then farther than 13 degrees from an edge, nor longer than the geodesic by more than 1 / cos 13 degrees."""
_N_LIKE = 9
"""Poses about a place of which one stands for it."""
_MOST_GAP = 2.5
"""Neighbours are at most this many times the median spacing apart."""
_MOST_TURN_RAD = np.deg2rad(60.0)
"""Between neighbours the surface turns by less than this: beyond it they lie on two sides of a sharp edge."""
_MOST_SLOPE = 0.7
"""The chord between neighbours lies along the surface: its slope against the mean normal is at most this sine."""


@dataclass(frozen=True, eq=False)
class Ways:
    """The shortest ways from one pose to all others."""

    start: int
    lengths_m: NDArray[np.float64]
    """Length of each [m], infinite where there is none, shape (N,)."""
    before: NDArray[np.int32]
    """The pose before each on its way, negative where there is none, shape (N,)."""

    def to(self, end: int) -> tuple[int, ...]:
        """The poses of the way to one, both ends among them; empty where there is none."""
        if not np.isfinite(self.lengths_m[end]):
            return ()
        way = [int(end)]
        while way[-1] != self.start:
            way.append(int(self.before[way[-1]]))
        return tuple(reversed(way))


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Neighbouring poses of a workspace that the probe glides between, with the length of each way."""

    workspace: Workspace
    pairs: NDArray[np.intp]
    """The two poses of each edge, the lower index first, shape (E, 2)."""
    lengths_m: NDArray[np.float64]
    """Length of each edge over the surface [m], shape (E,)."""

    def __post_init__(self) -> None:
        """Checks shapes and indices.

        Raises:
            PlannerError: If an edge is none of two poses, or has no length above 0.
        """
        n = self.workspace.n_poses
        pairs, lengths_m = self.pairs, self.lengths_m
        if pairs.shape != (len(pairs), 2) or lengths_m.shape != (len(pairs),):
            raise PlannerError(f"edges have shapes {pairs.shape} and {lengths_m.shape}, not (E, 2) and (E,)")
        if len(pairs) and not ((pairs >= 0) & (pairs < n)).all():
            raise PlannerError(f"an edge names a pose that is none of 0 .. {n - 1}")
        if not (np.isfinite(lengths_m) & (lengths_m > 0.0)).all():
            raise PlannerError("an edge's length must be above 0 and finite")

    @classmethod
    def of_surface(cls, workspace: Workspace) -> Roadmap:
        """The roadmap of a probe that nothing holds back: an edge joins each two poses that lie side by side."""
        pairs = neighbour_pairs(workspace)
        return cls(workspace, pairs, surface_lengths_m(workspace, pairs))

    def part(self, is_kept: NDArray[np.bool_]) -> Roadmap:
        """The roadmap without some of its edges.

        Args:
            is_kept: Which edges stay, shape (E,).
        """
        return Roadmap(self.workspace, self.pairs[is_kept], self.lengths_m[is_kept])

    @cached_property
    def graph(self) -> sparse.csr_matrix:
        """The lengths of the edges in both directions [m], shape (N, N)."""
        n, (a, b) = self.workspace.n_poses, self.pairs.T
        both = np.concatenate([a, b]), np.concatenate([b, a])
        return sparse.csr_matrix((np.tile(self.lengths_m, 2), both), shape=(n, n))

    @cached_property
    def islands(self) -> NDArray[np.intp]:
        """The island of each pose, within which the probe glides everywhere, numbered by falling size, shape (N,)."""
        _, island = connected_components(self.graph, directed=False)
        rank = np.empty(island.max() + 1, dtype=np.intp)
        rank[np.argsort(-np.bincount(island), kind="stable")] = np.arange(island.max() + 1)
        return rank[island]

    @property
    def spacing_m(self) -> float:
        """The median length of an edge [m]; 0 without edges."""
        return float(np.median(self.lengths_m)) if len(self.lengths_m) else 0.0

    def ways_from(self, start: int) -> Ways:
        """The shortest ways from a pose to all others (Dijkstra, 1959); those asked for last are kept.

        Args:
            start: Index of the pose.
        """
        return _ways(self, int(start))

    def nearest(
        self, places_m: NDArray[np.float64], beams: NDArray[np.float64], lever_m: float
    ) -> NDArray[np.intp]:
        """The poses that look most nearly from some places along some beams, shape (K,).

        Of the poses about a place it is the one that lies nearest, together with its beam's point at a depth.

        Args:
            places_m: Places on the surface [m], shape (K, 3).
            beams: Unit vectors, shape (K, 3).
            lever_m: The depth [m].
        """
        count = min(_N_LIKE, self.workspace.n_poses)
        index = np.asarray(self._tree.query(places_m, k=count)[1], dtype=np.intp).reshape(-1, count)
        away_m = np.linalg.norm(self.workspace.positions_m[index] - places_m[:, None], axis=2)
        off_m = lever_m * np.linalg.norm(self.workspace.normals[index] - beams[:, None], axis=2)
        return index[np.arange(len(index)), np.argmin(away_m + off_m, axis=1)]

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.workspace.positions_m)


@lru_cache(maxsize=64)
def _ways(roadmap: Roadmap, start: int) -> Ways:
    lengths_m, before = dijkstra(roadmap.graph, directed=False, indices=start, return_predecessors=True)
    return Ways(start, lengths_m, before)


def neighbour_pairs(workspace: Workspace) -> NDArray[np.intp]:
    """The pairs of poses that lie side by side on one sheet of the surface, the lower index first, shape (E, 2)."""
    count = min(_N_NEIGHBOURS, workspace.n_poses - 1)
    if count < 1:
        return np.empty((0, 2), dtype=np.intp)
    positions_m, normals = workspace.positions_m, workspace.normals
    others = workspace.neighbours(count)
    a = np.repeat(np.arange(workspace.n_poses), count)
    b = others.ravel()
    chords_m = positions_m[b] - positions_m[a]
    apart_m = np.linalg.norm(chords_m, axis=1)
    nearest_m = apart_m.reshape(-1, count)[:, 0]
    is_near = (apart_m > 0.0) & (apart_m <= _MOST_GAP * np.median(nearest_m))
    is_smooth = np.einsum("ij,ij->i", normals[a], normals[b]) >= np.cos(_MOST_TURN_RAD)
    mean = normals[a] + normals[b]
    rise_m = np.abs(np.einsum("ij,ij->i", chords_m, mean)) / np.maximum(np.linalg.norm(mean, axis=1), 1e-9)
    is_kept = is_near & is_smooth & (rise_m <= _MOST_SLOPE * apart_m)
    pairs = np.sort(np.column_stack([a, b])[is_kept], axis=1)
    return np.unique(pairs, axis=0).astype(np.intp)


def surface_lengths_m(workspace: Workspace, pairs: NDArray[np.intp]) -> NDArray[np.float64]:
    """The length of the surface between neighbouring poses [m], shape (E,): that of a circle's arc.

    Over a chord c along which the normal turns by t, the arc of constant curvature has the length
    c (t / 2) / sin(t / 2); on a sphere it is the geodesic.

    Args:
        workspace: The N poses.
        pairs: Pairs of neighbours, shape (E, 2).
    """
    a, b = pairs.T
    chords_m = np.linalg.norm(workspace.positions_m[b] - workspace.positions_m[a], axis=1)
    half = np.linalg.norm(workspace.normals[b] - workspace.normals[a], axis=1) / 2.0
    half_turn_rad = np.arcsin(np.minimum(half, 1.0))
    is_flat = half_turn_rad < 1e-6
    return chords_m * np.where(is_flat, 1.0, half_turn_rad / np.where(is_flat, 1.0, half))


def read_at(along_m: NDArray[np.float64], every_m: float) -> NDArray[np.intp]:
    """The indices of the places of a way at which a reading is taken; the last place is one, the first is none.

    A reading is taken at the first place that lies at least `every_m` beyond the last one.

    Args:
        along_m: Length of the way up to each place [m], rising from 0, shape (K,).
        every_m: Way from reading to reading [m].
    """
    chosen, last_m = [], 0.0
    for index in range(1, len(along_m)):
        if along_m[index] - last_m >= every_m - 1e-9:
            chosen.append(index)
            last_m = float(along_m[index])
    if len(along_m) > 1 and (not chosen or chosen[-1] != len(along_m) - 1):
        # What is left at the end is too short for a reading of its own: the last one is moved there.
        if chosen and along_m[-1] - last_m < every_m / 2.0:
            chosen.pop()
        chosen.append(len(along_m) - 1)
    return np.array(chosen, dtype=np.intp)


def along_m(workspace: Workspace, way: Sequence[int]) -> NDArray[np.float64]:
    """The length of a way of neighbouring poses up to each of them [m], shape (K,)."""
    steps = np.column_stack([way[:-1], way[1:]]).astype(np.intp)
    return np.concatenate([[0.0], np.cumsum(surface_lengths_m(workspace, steps))])

"""Which search points each pose's cone holds, found out once for an organ and kept."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from ..cone import Cone
from ..keyed_array import KeyedArray
from ..visibility import visibility
from ..workspace import Workspace

_POSES_AT_ONCE = 500
"""The table of all pairs is made in parts of so many poses, as it is far larger than what is kept of it."""


@dataclass(frozen=True, eq=False)
class Sight:
    """The sparse table of poses and the points in their cones."""

    table: csr_array
    """Ones where a pose's cone holds a point, shape (N, M)."""
    n_points: int
    """The number of points, M."""

    def sums(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """The sum of the weights in each pose's cone, shape (N,).

        Args:
            weights: One for each point, shape (M,).
        """
        return np.asarray(self.table @ weights.astype(np.float32), dtype=np.float64)

    def held_by(self, poses: tuple[int, ...]) -> NDArray[np.bool_]:
        """Which points lie in the cone of at least one of some poses, shape (M,).

        Args:
            poses: Indices of poses.
        """
        is_held = np.zeros(self.n_points, dtype=np.bool_)
        for pose in poses:
            is_held[self.table.indices[self.table.indptr[pose] : self.table.indptr[pose + 1]]] = True
        return is_held


def sight_of(workspace: Workspace, cone: Cone, points_m: NDArray[np.float64]) -> Sight:
    """The table of an organ; the same arguments give the same object.

    Args:
        workspace: The N poses.
        cone: What one of them sees.
        points_m: The points [m, world], shape (M, 3), which must not be changed afterwards.
    """
    return _sight_of(workspace, cone, KeyedArray(points_m))


@lru_cache(maxsize=2)
def _sight_of(workspace: Workspace, cone: Cone, points: KeyedArray) -> Sight:
    parts = []
    for start in range(0, workspace.n_poses, _POSES_AT_ONCE):
        part = workspace.part(slice(start, start + _POSES_AT_ONCE))
        parts.append(csr_array(visibility(part, cone, points.array).T, dtype=np.float32))
    return Sight(csr_array(vstack(parts, format="csr")), len(points.array))

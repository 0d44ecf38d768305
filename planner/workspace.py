"""The workspace: every pose from which the probe may sense (the paper's S)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from .errors import PlannerError

UNIT_TOLERANCE = 1e-6
"""Largest deviation of a normal's length from 1: far above float64 rounding, far below any real mistake."""


@dataclass(frozen=True, eq=False)
class Workspace:
    """All sensing poses of a scenario: surface positions and inward unit normals; the roll is free."""

    positions_m: NDArray[np.float64]
    """Positions on the organ's surface [m, world], shape (N, 3)."""
    normals: NDArray[np.float64]
    """Unit normals that point into the organ, the directions of the beam [world], shape (N, 3)."""
    grid_shape: tuple[int, int] | None = None
    """Rows and columns when the positions are a regular grid in C order, else None."""

    def __post_init__(self) -> None:
        """Checks shapes, finiteness and lengths, and keeps read-only copies.

        Raises:
            PlannerError: If an array has another shape, is not finite, or a normal is not of length 1.
        """
        for name in ("positions_m", "normals"):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
                raise PlannerError(f"{name} must have shape (N, 3) with N of at least 1, got {array.shape}")
            if not np.isfinite(array).all():
                raise PlannerError(f"{name} must be finite; row {_first_bad_row(array)} is not")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if len(self.positions_m) != len(self.normals):
            raise PlannerError(
                f"{len(self.positions_m)} positions but {len(self.normals)} normals: give one each"
            )
        lengths = np.linalg.norm(self.normals, axis=1)
        worst = int(np.argmax(np.abs(lengths - 1.0)))
        if abs(lengths[worst] - 1.0) > UNIT_TOLERANCE:
            raise PlannerError(
                f"normals must have length 1 within {UNIT_TOLERANCE:g}; normal {worst} has length "
                f"{lengths[worst]:.6g}: divide the normals by their lengths"
            )
        if self.grid_shape is not None and int(np.prod(self.grid_shape)) != self.n_poses:
            raise PlannerError(f"grid_shape {self.grid_shape} does not hold {self.n_poses} poses")

    @property
    def n_poses(self) -> int:
        """The number of poses, N."""
        return len(self.positions_m)

    def part(self, poses: NDArray[np.intp] | NDArray[np.bool_] | Sequence[int] | slice) -> Workspace:
        """Some of the poses, which form no grid any more.

        Args:
            poses: Their indices, a mask of shape (N,), or a slice, of which at least one pose is kept.

        Raises:
            PlannerError: If none is kept.
        """
        index = poses if isinstance(poses, slice | np.ndarray) else list(poses)
        return Workspace(self.positions_m[index], self.normals[index])

    def neighbours(self, n_neighbours: int) -> NDArray[np.intp]:
        """The indices of every pose's nearest other poses, nearest first, shape (N, n_neighbours).

        Args:
            n_neighbours: Number of neighbours, from 1 to N - 1.

        Raises:
            PlannerError: If the workspace does not hold so many other poses.
        """
        if not 1 <= n_neighbours < self.n_poses:
            raise PlannerError(f"n_neighbours must lie in 1 .. {self.n_poses - 1}, got {n_neighbours}")
        _, nearest = self._tree.query(self.positions_m, k=n_neighbours + 1)
        # A pose is not its own neighbour. Poses at one place may list one another first, so drop by index;
        # where a pose is missing from its own list (many at one place), drop the last.
        nearest = np.asarray(nearest)
        is_other = nearest != np.arange(self.n_poses)[:, None]
        is_other[is_other.all(axis=1), -1] = False
        return nearest[is_other].reshape(self.n_poses, n_neighbours)

    def within(self, pose: int, radius_m: float) -> list[int]:
        """The indices of the poses within a distance of one, itself included.

        Args:
            pose: Its index.
            radius_m: The distance [m].
        """
        return self._tree.query_ball_point(self.positions_m[pose], radius_m)

    def best_apart(self, score: NDArray[np.float64], gap_m: float) -> NDArray[np.intp]:
        """The pose of highest score in each cube of side `gap_m` that holds one above 0, best first, shape (k,).

        Args:
            score: Score of every pose, shape (N,).
            gap_m: Side of the cubes [m].
        """
        order = np.argsort(-score, kind="stable")
        order = order[score[order] > 0.0]
        cubes = np.floor(self.positions_m[order] / gap_m).astype(int)
        return order[np.sort(np.unique(cubes, axis=0, return_index=True)[1])]

    def angles_to_rad(self, point_m: ArrayLike) -> NDArray[np.float64]:
        """The angle between each pose's normal and the direction to a point [rad], shape (N,).

        With p the position, o the normal and q = a - p the paper's query vector to the point a, it is the angle
        arccos(o . q / |q|) = arctan2(|o x q|, o . q) of section IV-C. A pose at the point itself counts as aligned: 0.

        Args:
            point_m: The point a [m, world], shape (3,).
        """
        towards = np.asarray(point_m, dtype=np.float64) - self.positions_m
        axial = np.einsum("ij,ij->i", towards, self.normals)
        lateral = np.linalg.norm(np.cross(self.normals, towards), axis=1)
        # Exact near 0, where arccos loses half the digits; arctan2(0, 0) is 0.
        return np.arctan2(lateral, axial)

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.positions_m)


def _first_bad_row(array: NDArray[np.float64]) -> int:
    return int(np.argmin(np.isfinite(array).all(axis=1)))

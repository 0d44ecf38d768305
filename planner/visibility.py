"""Which poses' cones hold which points: the same test as `Cone.contains`, for all pairs at once."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .cone import Cone
from .workspace import Workspace

_POINTS_AT_ONCE = 16
"""Points per block of the dense table, so that a block stays in the processor's cache."""
_POSES_AT_ONCE = 512
"""Largest number of poses in a part of `scattered_poses`."""


def visibility(workspace: Workspace, cone: Cone, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which poses' cones hold which points, shape (M, N).

    As matrix products, the test of `Cone` is 0 <= a <= d and |x - p|^2 <= a^2 (1 + tan^2(alpha)), a = (x - p) . o.

    Args:
        workspace: The N poses.
        cone: What one of them sees.
        points_m: The points [m, world], shape (M, 3).
    """
    # About their centre coordinates are small, and squares round far below a micrometre.
    centre_m = workspace.positions_m.mean(axis=0)
    positions_m, points_m = workspace.positions_m - centre_m, points_m - centre_m
    sees = np.empty((len(points_m), workspace.n_poses), dtype=np.bool_)
    for start in range(0, len(points_m), _POINTS_AT_ONCE):
        block = slice(start, start + _POINTS_AT_ONCE)
        sees[block] = _sees(positions_m, workspace.normals, cone, points_m[block])
    return sees


def visible_points(workspace: Workspace, cone: Cone, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each point lies in the cone of at least one pose, shape (M,), without a table of all pairs.

    Args:
        workspace: The N poses.
        cone: What one of them sees.
        points_m: The points [m, world], shape (M, 3).
    """
    is_visible = np.zeros(len(points_m), dtype=np.bool_)
    for poses in scattered_poses(workspace.n_poses):
        part = workspace.part(poses)
        open_points = np.flatnonzero(~is_visible)
        is_visible[open_points] = visibility(part, cone, points_m[open_points]).any(axis=1)
    return is_visible


def scattered_poses(n_poses: int) -> Iterator[NDArray[np.intp]]:
    """The indices of all poses in parts of some 500, each scattered over the workspace: the first part sees most."""
    n_parts = -(-n_poses // _POSES_AT_ONCE)
    for first in range(n_parts):
        yield np.arange(first, n_poses, n_parts)


def _sees(
    positions_m: NDArray[np.float64], normals: NDArray[np.float64], cone: Cone, points_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    axial_m = points_m @ normals.T - np.einsum("ij,ij->i", positions_m, normals)
    squared = (
        np.einsum("ij,ij->i", points_m, points_m)[:, None]
        - 2.0 * points_m @ positions_m.T
        + np.einsum("ij,ij->i", positions_m, positions_m)
    )
    reach = (1.0 + math.tan(cone.half_angle_rad) ** 2) * axial_m**2
    return (axial_m >= 0.0) & (axial_m <= cone.depth_m) & (squared <= reach)

"""What could be sensed at best: the union of the cones of all poses that the probe can reach."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner import Cone, Workspace

from .carrier import Carrier


def visibility(
    workspace: Workspace, cone: Cone, points_m: NDArray[np.float64], chunk: int = 256
) -> NDArray[np.bool_]:
    """Which poses' cones hold which points, shape (n_points, n_poses).

    The same test as `Cone.contains`, written as matrix products: axial = p.n - x.n, lateral^2 = |p - x|^2 - axial^2.
    """
    centre_m = workspace.positions_m.mean(
        axis=0
    )  # small coordinates keep the squares' rounding far below a micron
    positions_m, points_m = workspace.positions_m - centre_m, points_m - centre_m
    along_m = np.einsum("ij,ij->i", positions_m, workspace.normals)
    positions_squared = np.einsum("ij,ij->i", positions_m, positions_m)
    sees = np.empty((len(points_m), workspace.n_poses), dtype=bool)
    slope_squared = 1.0 + np.tan(cone.half_angle_rad) ** 2
    for start in range(0, len(points_m), chunk):
        part_m = points_m[start : start + chunk]
        axial_m = part_m @ workspace.normals.T - along_m
        squared = (
            np.einsum("ij,ij->i", part_m, part_m)[:, None] - 2.0 * part_m @ positions_m.T + positions_squared
        )
        sees[start : start + chunk] = (
            (axial_m >= 0.0) & (axial_m <= cone.depth_m) & (squared <= slope_squared * axial_m**2)
        )
    return sees


def attainable(sees: NDArray[np.bool_], carrier: Carrier, *, max_failures: int = 100) -> NDArray[np.bool_]:
    """Which points some reachable pose sees, shape (n_points,).

    Asks for the pose that sees most of the points still open, until none is left to ask for, so that a few dozen IK
    answers settle what thousands would.

    Args:
        sees: Which poses see which points, shape (n_points, n_poses).
        carrier: Decides whether a pose is reached.
        max_failures: Unreachable poses asked for at most; beyond it the open points count as unattainable.
    """
    is_attained = np.zeros(len(sees), dtype=bool)
    n_open_seen = sees.sum(axis=0)
    n_failures = 0
    while n_open_seen.max(initial=0) > 0 and n_failures < max_failures:
        pose = int(np.argmax(n_open_seen))
        if not carrier.reach(pose).is_reached:
            n_failures += 1
            n_open_seen[pose] = -1
            continue
        newly = sees[:, pose] & ~is_attained
        is_attained |= newly
        n_open_seen -= sees[newly].sum(axis=0)
    return is_attained

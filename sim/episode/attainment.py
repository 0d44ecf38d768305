"""What could be sensed at best: the union of the cones of all poses that the probe can reach."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner import Cone, Workspace, scattered_poses, visibility, visible_points

from .positioner import Positioner

if TYPE_CHECKING:
    from .setup import Setup


def attainable(
    workspace: Workspace,
    cone: Cone,
    points_m: NDArray[np.float64],
    positioner: Positioner,
    *,
    max_failures: int = 100,
) -> NDArray[np.bool_]:
    """Which points some reachable pose sees, shape (M,).

    A scattered part of the poses is looked at first, in which most points are settled, then the next. In each part the
    pose is tried that sees most of the open points, so that a few dozen IK answers settle what thousands would.

    Args:
        workspace: The poses.
        cone: What one of them sees.
        points_m: The points [m, world], shape (M, 3).
        positioner: Decides whether a pose is reached.
        max_failures: Most poses that may prove unreachable; after that many, open points count as unattainable.
    """
    is_attained, n_failures = np.zeros(len(points_m), dtype=bool), 0
    for poses in scattered_poses(workspace.n_poses):
        open_points = np.flatnonzero(~is_attained)
        if not open_points.size or n_failures == max_failures:
            break
        part = workspace.part(poses)
        sees = visibility(part, cone, points_m[open_points])
        settled, n_new = _settle(sees, poses, positioner, max_failures - n_failures)
        is_attained[open_points[settled]] = True
        n_failures += n_new
    return is_attained


def _settle(
    sees: NDArray[np.bool_], poses: NDArray[np.intp], positioner: Positioner, max_failures: int
) -> tuple[NDArray[np.bool_], int]:
    """Which points some reachable one of a few poses sees, and how many of the poses tried are not reached."""
    is_attained, n_failures = np.zeros(len(sees), dtype=bool), 0
    n_open_seen = sees.sum(axis=0)
    while n_open_seen.max(initial=0) > 0 and n_failures < max_failures:
        column = int(np.argmax(n_open_seen))
        if not positioner.reach(int(poses[column])).is_reached:
            n_failures += 1
            n_open_seen[column] = -1
            continue
        newly = sees[:, column] & ~is_attained
        is_attained |= newly
        n_open_seen -= sees[newly].sum(axis=0)
    return is_attained, n_failures


def seeable_points(setup: Setup, lost: Iterable[int]) -> NDArray[np.bool_]:
    """Which search points of a setup lie in the cone of a pose that was not found to be out of reach, shape (M,).

    Args:
        setup: The setup.
        lost: The poses that were found to be out of reach; of the others it need not be known.
    """
    is_seeable, workspace = setup.is_visible.copy(), setup.workspace
    out = np.array(sorted(lost), dtype=np.intp)
    if not out.size:
        return is_seeable
    # Only what the lost poses see has to be looked at again.
    doubtful = np.flatnonzero(visible_points(workspace.part(out), setup.cone, setup.search_points_m))
    is_seeable[doubtful] = False
    kept = np.delete(np.arange(workspace.n_poses), out)
    if kept.size:
        points_m = setup.search_points_m[doubtful]
        is_seeable[doubtful] = visible_points(workspace.part(kept), setup.cone, points_m)
    return is_seeable

"""Where the probe really stands: the poses of a workspace that it reaches, as the tips and beams of their cones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner import Cone, Workspace, visibility
from sim.episode.positioner import FreePositioner
from sim.episode.setup import Setup

AT_ONCE = 512
"""Poses whose answers are found together."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StandingPoses:
    """The poses that are reached, with the cone of each where the probe stands then."""

    pose: NDArray[np.intp]
    """Their indices in the workspace, rising, shape (N,)."""
    apex_m: NDArray[np.float64]
    """The tips [m, world], shape (N, 3)."""
    axis: NDArray[np.float64]
    """Unit vectors along the beams, shape (N, 3)."""

    @property
    def n_poses(self) -> int:
        """The number of poses that are reached."""
        return len(self.pose)

    def part(self, rows: NDArray[np.intp]) -> StandingPoses:
        """Some of the poses.

        Args:
            rows: Which, as rows of these arrays.
        """
        return StandingPoses(pose=self.pose[rows], apex_m=self.apex_m[rows], axis=self.axis[rows])

    def sees(self, cone: Cone, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which pose's cone holds which point, shape (N, M).

        Args:
            cone: What one of them sees.
            points_m: The points [m, world], shape (M, 3).
        """
        if not self.n_poses:
            return np.zeros((0, len(points_m)), dtype=bool)
        return np.ascontiguousarray(visibility(Workspace(self.apex_m, self.axis), cone, points_m).T)


def standing_poses(setup: Setup, on_progress: Callable[[int], object] = lambda n: None) -> StandingPoses:
    """The poses of a setup that its probe reaches, where an episode's motion brings it.

    A free probe stands at the poses themselves. An arm stands where its inverse kinematics ends, some micrometres away,
    which is where the kinematic motion leads, and where the cones of an episode are counted from.

    Args:
        setup: The setup.
        on_progress: Called with the number of poses that were tried since the last call.
    """
    workspace, positioner = setup.workspace, setup.positioner
    if isinstance(positioner, FreePositioner):
        on_progress(workspace.n_poses)
        every = np.arange(workspace.n_poses)
        return StandingPoses(pose=every, apex_m=workspace.positions_m, axis=workspace.normals)
    data, tip = setup.scene.new_data(), setup.scene.tip_site
    poses, apexes_m, axes = list[int](), [np.empty((0, 3))], [np.empty((0, 3))]
    for first in range(0, workspace.n_poses, AT_ONCE):
        part = range(first, min(first + AT_ONCE, workspace.n_poses))
        positioner.prepare(part)
        for pose in part:
            if positioner.reach(pose).is_reached:
                positioner.place(data, pose, is_lifted=False)
                poses.append(pose)
                apexes_m.append(data.site(tip).xpos.copy()[None])
                axes.append(data.site(tip).xmat.reshape(3, 3)[:, 2].copy()[None])
        on_progress(len(part))
    return StandingPoses(
        pose=np.array(poses, dtype=np.intp), apex_m=np.concatenate(apexes_m), axis=np.concatenate(axes)
    )

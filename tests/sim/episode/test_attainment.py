"""What could be sensed at best, against brute force over all poses."""

from __future__ import annotations

import numpy as np

from planner import Workspace, visibility, visible_points
from sim.episode.attainment import attainable, seeable_points
from sim.episode.positioner import Positioner
from sim.world.ik.result import IkResult, IkStatus


class PickyPositioner(Positioner):
    """Reaches every pose but some, and counts how often it was asked."""

    def __init__(self, unreachable: set[int]) -> None:
        self.unreachable, self.asked = unreachable, []

    def reach(self, pose: int) -> IkResult:
        self.asked.append(pose)
        status = IkStatus.TOO_FAR if pose in self.unreachable else IkStatus.REACHED
        return IkResult(status, np.empty(0), np.empty(0), 0.0, 0.0, 0, 0)

    def place(self, data, pose, *, is_lifted) -> None:
        raise NotImplementedError

    def shift(self, data, T_world_tip) -> str:
        raise NotImplementedError


def random_workspace(rng: np.random.Generator, n: int) -> Workspace:
    normals = rng.normal(size=(n, 3)) * [0.2, 0.2, 1.0] - [0, 0, 3.0]
    return Workspace(
        rng.uniform(-0.08, 0.08, (n, 3)) * [1, 1, 0.1] + 1.0,
        normals / np.linalg.norm(normals, axis=1)[:, None],
    )


def test_visibility_equals_the_cone_pose_by_pose(cone) -> None:
    rng = np.random.default_rng(0)
    workspace = random_workspace(rng, 300)
    points_m = 1.0 + rng.uniform([-0.1, -0.1, -0.12], [0.1, 0.1, 0.01], (700, 3))
    sees = visibility(workspace, cone, points_m)
    expected = np.column_stack(
        [
            cone.contains(points_m, *pose)
            for pose in zip(workspace.positions_m, workspace.normals, strict=True)
        ]
    )
    assert (sees != expected).sum() <= 1  # of 210,000: a point may lie on a mantle to rounding
    assert sees.any()


def test_attainable_is_the_union_over_reachable_poses_with_few_questions(cone) -> None:
    rng = np.random.default_rng(1)
    workspace = random_workspace(rng, 1400)
    points_m = 1.0 + rng.uniform([-0.1, -0.1, -0.12], [0.1, 0.1, 0.0], (500, 3))
    sees = visibility(workspace, cone, points_m)
    unreachable = set(rng.choice(1400, 210, replace=False).tolist())
    positioner = PickyPositioner(unreachable)
    reachable = [pose for pose in range(1400) if pose not in unreachable]
    assert np.array_equal(attainable(workspace, cone, points_m, positioner), sees[:, reachable].any(axis=1))
    assert len(positioner.asked) == len(set(positioner.asked)) < 200


def test_nothing_is_attainable_for_an_arm_that_reaches_nothing(cone) -> None:
    positioner = PickyPositioner(set(range(1200)))
    workspace = random_workspace(np.random.default_rng(2), 1200)
    points_m = workspace.positions_m[:50] + 0.01 * workspace.normals[:50]
    assert not attainable(workspace, cone, points_m, positioner, max_failures=7).any()
    assert len(positioner.asked) == 7


def test_seeable_is_the_union_over_the_poses_that_are_not_lost(sphere_setup) -> None:
    workspace = sphere_setup.workspace
    assert np.array_equal(seeable_points(sphere_setup, ()), sphere_setup.is_visible)
    # All poses of one half of the surface.
    lost = np.flatnonzero(workspace.positions_m[:, 0] > 0.5)
    kept = np.flatnonzero(workspace.positions_m[:, 0] <= 0.5)
    left = Workspace(workspace.positions_m[kept], workspace.normals[kept])
    expected = visible_points(left, sphere_setup.cone, sphere_setup.search_points_m)
    assert np.array_equal(seeable_points(sphere_setup, lost.tolist()), expected)
    assert not seeable_points(sphere_setup, range(workspace.n_poses)).any()

"""Who sees what, against the cone's own test and against geometry."""

import numpy as np
import pytest
from planner_situations import box_points, flat_workspace

from planner import Cone, Workspace, visibility, visible_points

CONE = Cone(0.25, 0.08)


def bumpy_workspace(n_poses=1_300):
    rng = np.random.default_rng(5)
    normals = rng.normal([0.0, 0.0, -1.0], 0.3, (n_poses, 3))
    positions = np.column_stack([rng.uniform(-0.08, 0.08, (n_poses, 2)), rng.uniform(0.4, 0.41, n_poses)])
    return Workspace(positions, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def points_below(n_points=700):
    return np.random.default_rng(6).uniform([-0.12, -0.12, 0.3], [0.12, 0.12, 0.42], (n_points, 3))


def test_the_table_agrees_with_each_cones_own_test():
    workspace, points = bumpy_workspace(), points_below()
    expected = CONE.contains(points[:, None], workspace.positions_m, workspace.normals)
    table = visibility(workspace, CONE, points)
    assert expected.any()
    # Two roundings of one inequality: only a point within about 1e-16 m^2 of a mantle could differ.
    np.testing.assert_array_equal(table, expected)


def test_visible_points_are_those_that_some_pose_sees():
    workspace, points = bumpy_workspace(), points_below()
    is_visible = visible_points(workspace, CONE, points)
    assert 0.1 < is_visible.mean() < 0.9
    np.testing.assert_array_equal(is_visible, visibility(workspace, CONE, points).any(axis=1))


@pytest.mark.parametrize(("depth_m", "is_seen"), [(0.079, True), (0.081, False)])
def test_the_cones_depth_is_how_far_down_a_flat_workspace_sees(depth_m, is_seen):
    points = box_points(depth_m=0.05) * [0.5, 0.5, 0.0] - [0.0, 0.0, depth_m]
    assert (visible_points(flat_workspace(), CONE, points) == is_seen).all()

"""The workspace: what it refuses, and its geometry against brute force."""

import math

import numpy as np
import pytest
from planner_situations import flat_workspace, make_situation

from planner import PlannerError, Workspace

DOWN = np.array([0.0, 0.0, -1.0])


def test_neighbours_agree_with_all_distances_sorted():
    positions = np.random.default_rng(0).uniform(size=(60, 3))
    workspace = Workspace(positions, np.tile(DOWN, (60, 1)))
    distances = np.linalg.norm(positions[:, None] - positions[None], axis=-1)
    np.fill_diagonal(distances, np.inf)
    np.testing.assert_array_equal(workspace.neighbours(10), np.argsort(distances, axis=1)[:, :10])


def test_poses_at_one_place_are_neighbours_of_one_another_but_never_of_themselves():
    workspace = Workspace(np.zeros((5, 3)), np.tile(DOWN, (5, 1)))
    neighbours = workspace.neighbours(2)
    assert neighbours.shape == (5, 2)
    assert all(pose not in row for pose, row in enumerate(neighbours))


def test_angles_are_those_of_elementary_trigonometry():
    workspace = flat_workspace(n_side=5, width_m=0.2)
    point = np.array([0.1, 0.0, -0.1])
    offsets = np.hypot(workspace.positions_m[:, 0] - 0.1, workspace.positions_m[:, 1])
    # Two float64 formulas for one angle: a few roundings apart.
    np.testing.assert_allclose(workspace.angles_to_rad(point), np.arctan(offsets / 0.1), atol=1e-14)


def test_a_pose_at_the_point_is_aligned_and_one_that_looks_away_is_not():
    workspace = Workspace(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.1]]), np.array([DOWN, DOWN]))
    np.testing.assert_allclose(workspace.angles_to_rad(np.zeros(3)), [0.0, math.pi])


@pytest.mark.parametrize(
    ("positions", "normals", "grid_shape", "message"),
    [
        (np.zeros((2, 2)), np.tile(DOWN, (2, 1)), None, r"positions_m must have shape \(N, 3\)"),
        (np.zeros((0, 3)), np.zeros((0, 3)), None, "at least 1"),
        (np.full((1, 3), np.nan), DOWN[None], None, "row 0 is not"),
        (np.zeros((3, 3)), np.tile(DOWN, (2, 1)), None, "3 positions but 2 normals"),
        (np.zeros((1, 3)), 2 * DOWN[None], None, "length 2: divide"),
        (np.zeros((4, 3)), np.tile(DOWN, (4, 1)), (3, 2), "does not hold 4 poses"),
    ],
)
def test_what_is_not_a_workspace_is_refused(positions, normals, grid_shape, message):
    with pytest.raises(PlannerError, match=message):
        Workspace(positions, normals, grid_shape)


def test_it_keeps_its_own_read_only_copy():
    positions = np.zeros((1, 3))
    workspace = Workspace(positions, DOWN[None])
    positions[0] = 5.0
    assert (workspace.positions_m == 0.0).all()
    with pytest.raises(ValueError, match="read-only"):
        workspace.normals[0] = 1.0


def test_asking_for_more_neighbours_than_there_are_is_refused():
    with pytest.raises(PlannerError, match=r"n_neighbours must lie in 1 \.\. 24"):
        flat_workspace(n_side=5).neighbours(25)


def test_a_situation_refuses_poses_that_do_not_exist_and_beliefs_of_another_lattice():
    with pytest.raises(PlannerError, match=r"sensed holds pose 400.*0 \.\. 399"):
        make_situation(sensed=(400,))
    with pytest.raises(PlannerError, match="search points"):
        make_situation(mean=np.zeros(3), variance=np.ones(3))

"""The cone against geometry done another way."""

import math

import numpy as np
import pytest

from planner import Cone, PlannerError


def test_share_of_a_box_in_the_cone_is_the_cones_volume():
    cone = Cone(math.radians(20.0), 0.1)
    radius = 0.1 * math.tan(math.radians(20.0))
    rng = np.random.default_rng(1)
    n_points = 200_000
    points = rng.uniform([-radius, -radius, 0.0], [radius, radius, 0.1], (n_points, 3))
    share = cone.contains(points, np.zeros(3), np.array([0.0, 0.0, 1.0])).mean()
    box_volume = (2 * radius) ** 2 * 0.1
    # Five standard errors of a share.
    tolerance = 5.0 * math.sqrt(share * (1 - share) / n_points)
    assert share == pytest.approx(cone.volume_m3 / box_volume, abs=tolerance)


def test_membership_does_not_change_under_a_rigid_motion():
    cone = Cone(0.3, 0.08)
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.1, 0.1, (5_000, 3))
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    shift = np.array([0.5, -0.2, 0.1])
    axis = np.array([0.0, 0.0, 1.0])
    before = cone.contains(points, np.zeros(3), axis)
    after = cone.contains(points @ rotation.T + shift, shift, rotation @ axis)
    assert before.any()
    np.testing.assert_array_equal(before, after)


def test_angle_and_depth_bound_the_cone_and_apex_and_base_belong_to_it():
    cone = Cone(math.radians(30.0), 1.0)
    axis = np.array([0.0, 0.0, -1.0])

    def at(angle_deg, axial):
        return [axial * math.tan(math.radians(angle_deg)), 0.0, -axial]

    points = np.array([at(0, 0.0), at(29.9, 0.5), at(30.1, 0.5), at(0, 1.0), at(0, 1.001), at(10, -0.2)])
    inside = cone.contains(points, np.zeros(3), axis)
    np.testing.assert_array_equal(inside, [True, True, False, True, False, False])


def test_one_point_against_many_poses_equals_many_single_questions():
    cone = Cone(0.4, 0.1)
    rng = np.random.default_rng(3)
    apexes = rng.uniform(-0.05, 0.05, (200, 3))
    axes = rng.normal(size=(200, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    point = np.array([0.01, 0.02, -0.03])
    together = cone.contains(point, apexes, axes)
    singly = [
        bool(cone.contains(point[None], apex, axis)[0]) for apex, axis in zip(apexes, axes, strict=True)
    ]
    assert together.any()
    np.testing.assert_array_equal(together, singly)


@pytest.mark.parametrize("half_angle", [0.0, math.pi / 2, 11.5, math.nan])
def test_a_half_angle_out_of_range_is_refused_with_the_remedy(half_angle):
    with pytest.raises(PlannerError, match=r"between 0 and pi / 2.*math\.radians"):
        Cone(half_angle, 0.1)


@pytest.mark.parametrize("depth", [0.0, -0.1, math.inf, math.nan])
def test_a_depth_out_of_range_is_refused(depth):
    with pytest.raises(PlannerError, match="depth_m must be above 0 m"):
        Cone(0.2, depth)

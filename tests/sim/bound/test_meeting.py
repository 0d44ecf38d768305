"""Which cones may meet a tumour: no cone that holds a point of it is left out, by either code."""

from __future__ import annotations

import numpy as np
import pytest

from planner import Cone
from sim.bound.check.plain_cones import gap_to_cones_m, held_points
from sim.bound.meeting import distance_m, meets
from sim.world.anatomy.tumour_shapes import ball_shape, lobulated_shape
from sim.world.solids.solid import Solid

CONE = Cone(0.25, 0.1)


@pytest.fixture
def cones():
    """Cones about the origin that look past it on all sides."""
    rng = np.random.default_rng(4)
    apex_m = rng.normal(scale=0.06, size=(800, 3))
    axis = rng.normal(scale=0.03, size=(800, 3)) - apex_m
    return apex_m, axis / np.linalg.norm(axis, axis=1, keepdims=True)


@pytest.mark.parametrize("shape", ["ball", "lobulated"])
def test_no_cone_that_holds_a_point_of_a_tumour_is_left_out(cones, shape):
    rng = np.random.default_rng(2)
    vertices_m, faces = ball_shape() if shape == "ball" else lobulated_shape(0.03, rng)
    tumour = Solid(vertices_m * (0.012 if shape == "ball" else 1.0), faces)
    apex_m, axis = cones
    is_outside = ~tumour.contains(apex_m)
    apex_m, axis = apex_m[is_outside], axis[is_outside]
    holds = held_points(apex_m, axis, 0.25, 0.1, tumour.sample_inside(3000, rng)).any(axis=1)
    may = meets(CONE, apex_m, axis, tumour)
    assert 50 < holds.sum() < 600
    assert not (holds & ~may).any()
    # Those that hold no point of 3,000 and may meet it graze it.
    assert (may & ~holds).sum() < 0.35 * may.sum()


def test_two_ways_to_the_distance_of_a_cone_agree(cones):
    apex_m, axis = cones
    point_m = np.array([0.01, -0.02, 0.015])
    ours = distance_m(CONE, apex_m, axis, point_m)
    theirs = gap_to_cones_m(apex_m, axis, 0.25, 0.1, point_m)
    np.testing.assert_allclose(ours, theirs, atol=1e-12)
    inside = held_points(apex_m, axis, 0.25, 0.1, point_m[None])[:, 0]
    assert ((ours == 0.0) == inside).all()


def test_the_distance_is_that_of_the_nearest_of_many_points_of_the_cone():
    rng = np.random.default_rng(8)
    depth_m = CONE.depth_m * np.cbrt(rng.random(400_000))
    radius_m = depth_m * np.tan(CONE.half_angle_rad) * np.sqrt(rng.random(400_000))
    turn = rng.uniform(0, 2 * np.pi, 400_000)
    inside_m = np.column_stack([radius_m * np.cos(turn), radius_m * np.sin(turn), depth_m])
    for point_m in rng.uniform(-0.08, 0.15, size=(10, 3)):
        nearest_m = np.linalg.norm(inside_m - point_m, axis=1).min()
        found_m = float(distance_m(CONE, np.zeros(3), np.array([0.0, 0.0, 1.0]), point_m))
        # The points lie about a millimetre apart.
        assert found_m <= nearest_m + 1e-12
        assert found_m == pytest.approx(nearest_m, abs=2e-3)

"""The points of a sweep: as many on each plane, even across the lines, and even in volume along them."""

import numpy as np
import pytest

from sim.world.sensing.ultrasound.convex_array import ConvexArray
from sim.world.sensing.ultrasound.sweep_pattern import NEAR_M, sweep_pattern

ARRAY = ConvexArray()


@pytest.fixture(scope="module")
def pattern():
    return sweep_pattern(ARRAY, n_planes=16, n_points=8000, rng=np.random.default_rng(0))


def test_each_plane_has_its_share_and_all_points_lie_on_lines_and_samples(pattern):
    planes, lines, samples = pattern
    assert np.array_equal(np.bincount(planes), np.full(16, 500))
    assert (lines >= 0.0).all()
    assert (lines <= ARRAY.n_lines - 1).all()
    assert (samples >= 0.0).all()
    assert (samples <= ARRAY.n_samples - 1).all()


def test_points_are_even_across_the_lines_and_in_volume_along_them(pattern):
    planes, lines, samples = pattern
    depth_m = (samples + 0.5) * ARRAY.sample_m
    for plane in range(16):
        on_plane = planes == plane
        # 500 points of a sequence without clumps: a tenth of the lines has 50 within a few; drawn at random, within 14.
        counts = np.histogram(lines[on_plane], bins=10, range=(0, ARRAY.n_lines - 1))[0]
        assert np.abs(counts - 50).max() <= 6
        # The density (R + r)(r + r0), integrated by hand.
        edges_m = np.linspace(0.0, ARRAY.depth_m, 11)
        radius_m = ARRAY.radius_m
        volume = radius_m * NEAR_M * edges_m + (radius_m + NEAR_M) * edges_m**2 / 2.0 + edges_m**3 / 3.0
        expected = 500 * np.diff(volume) / volume[-1]
        found = np.histogram(depth_m[on_plane], bins=edges_m)[0]
        assert np.abs(found - expected).max() <= 8


def test_points_of_a_plane_keep_apart(pattern):
    planes, lines, samples = pattern
    places = np.column_stack([lines / ARRAY.n_lines, samples / ARRAY.n_samples])[planes == 3]
    # Without clumps the nearest neighbour of 500 points in a unit square is some 0.03 away, at random 0.022.
    gaps = np.linalg.norm(places[:, None] - places[None], axis=2) + np.eye(500)
    assert gaps.min(axis=1).mean() > 0.025


def test_another_draw_shifts_the_points():
    one = sweep_pattern(ARRAY, n_planes=4, n_points=100, rng=np.random.default_rng(1))
    same = sweep_pattern(ARRAY, n_planes=4, n_points=100, rng=np.random.default_rng(1))
    other = sweep_pattern(ARRAY, n_planes=4, n_points=100, rng=np.random.default_rng(2))
    assert np.array_equal(one[1], same[1])
    assert not np.array_equal(one[1], other[1])

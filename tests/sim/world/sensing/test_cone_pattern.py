"""The cone's sampling: even in volume, without gaps, and turned and shifted by the rng."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from sim.world.sensing.cone_pattern import cone_pattern


def pattern_points_m(cone, n_rays: int, n_points_per_ray: int, seed: int) -> np.ndarray:
    """The pattern's points in the probe's frame [m], shape (R K, 3)."""
    rng = np.random.default_rng(seed)
    directions, ranges_m = cone_pattern(cone, n_rays=n_rays, n_points_per_ray=n_points_per_ray, rng=rng)
    return (ranges_m[..., None] * directions[:, None, :]).reshape(-1, 3)


def test_directions_are_unit_vectors_and_all_points_lie_in_the_cone(cone) -> None:
    directions, ranges_m = cone_pattern(cone, n_rays=50, n_points_per_ray=7, rng=np.random.default_rng(0))
    assert (directions.shape, ranges_m.shape) == ((50, 3), (50, 7))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-15)
    assert cone.contains(pattern_points_m(cone, 50, 7, 0), np.zeros(3), [0.0, 0.0, 1.0]).all()


def test_points_are_even_in_volume(cone) -> None:
    """Of a cone cut at depth s the volume share is (s / depth)^3; about the axis it is the square of the radius.

    The tolerance of 0.01 is the 97 % quantile of the same distance for 20,000 points drawn at random
    (Kolmogorov: 1.45 / sqrt(20,000)); the strata, 20 in depth and 1000 in radius, stay far below it.
    """
    points_m = pattern_points_m(cone, 1000, 20, 0)
    depth_m = points_m[:, 2]
    even = (np.arange(len(points_m)) + 0.5) / len(points_m)
    assert np.abs(np.sort((depth_m / cone.depth_m) ** 3) - even).max() < 0.01
    slope = np.linalg.norm(points_m[:, :2], axis=1) / (depth_m * np.tan(cone.half_angle_rad))
    assert np.abs(np.sort(slope**2) - even).max() < 0.01
    angle = np.arctan2(points_m[:, 1], points_m[:, 0]) / (2.0 * np.pi) + 0.5
    assert np.abs(np.sort(angle) - even).max() < 0.01


@pytest.mark.parametrize("seed", range(5))
def test_no_gaps_between_the_points(cone, seed: int) -> None:
    """A ball in which five points or more are expected holds some, wherever in the cone; random ones vary more."""
    points_m = pattern_points_m(cone, 100, 10, seed)
    rng = np.random.default_rng(seed)
    n_full = 10.0
    radius_m = (n_full / 1000 * cone.volume_m3 * 3.0 / (4.0 * np.pi)) ** (1 / 3)
    depth_m = cone.depth_m * np.cbrt(rng.uniform(0.05, 1.0, 2000))
    off_m = depth_m * np.tan(cone.half_angle_rad) * np.sqrt(rng.uniform(size=2000))
    angle_rad = rng.uniform(0.0, 2.0 * np.pi, 2000)
    centres_m = np.column_stack([off_m * np.cos(angle_rad), off_m * np.sin(angle_rad), depth_m])
    n_held = KDTree(points_m).query_ball_point(centres_m, radius_m, return_length=True)
    expected = n_full * _share_in_cone(cone, centres_m, radius_m, rng)
    is_full = expected > 0.5 * n_full
    assert is_full.sum() > 1000
    assert n_held[is_full].min() > 0
    spread = np.std(n_held[is_full] / expected[is_full])
    assert spread < 0.9 / np.sqrt(expected[is_full].mean())  # 1 / sqrt for points drawn at random


def _share_in_cone(cone, centres_m: np.ndarray, radius_m: float, rng: np.random.Generator) -> np.ndarray:
    """Share of each ball that lies in the cone, by drawn points."""
    draws = rng.normal(size=(500, 3))
    draws *= (radius_m * np.cbrt(rng.uniform(size=500)) / np.linalg.norm(draws, axis=1))[:, None]
    points = centres_m[:, None] + draws
    inside = np.linalg.norm(points[..., :2], axis=2) <= points[..., 2] * np.tan(cone.half_angle_rad)
    return (inside & (points[..., 2] <= cone.depth_m)).mean(axis=1)


def test_the_rng_turns_the_pattern_about_the_axis_and_shifts_points_along_the_rays(cone) -> None:
    first, again, other = (pattern_points_m(cone, 20, 5, seed) for seed in (3, 3, 4))
    assert first.tobytes() == again.tobytes()
    assert not np.allclose(first, other, atol=1e-4)


def test_it_draws_two_numbers_whatever_the_counts(cone) -> None:
    rng, two = np.random.default_rng(5), np.random.default_rng(5)
    cone_pattern(cone, n_rays=33, n_points_per_ray=4, rng=rng)
    two.uniform(size=2)
    assert rng.uniform() == two.uniform()

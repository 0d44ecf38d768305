"""Rays against surfaces: distances and signs of crossings, and winding numbers where bodies nest and overlap."""

from __future__ import annotations

import numpy as np
import pytest

from sim.world.scene.scene import build_scene
from sim.world.sensing.rays import SurfaceRays

OFF_M = 0.003
ABOVE_M = np.array([0.5 + OFF_M, 0.001, 0.2])
"""Above the ball's middle, but off the pole, at which many triangles meet."""
DOWN = np.array([[0.0, 0.0, -1.0]])
FACET_M = 1e-4
"""Facets of a ball of 60 mm lie inside it by up to edge^2 / (6 radius), 0.05 mm for edges of 4.2 mm."""


@pytest.fixture(scope="module")
def ball_scene(ball_anatomy, cone):
    return build_scene(ball_anatomy, cone, arm=None)


@pytest.fixture(scope="module")
def rays(ball_scene) -> SurfaceRays:
    return SurfaceRays(ball_scene)


@pytest.fixture
def data(ball_scene):
    return ball_scene.new_data()


def test_a_ray_through_a_ball_enters_and_leaves_it(rays, data) -> None:
    crossings = rays.crossings(data, ABOVE_M, DOWN, of="organ")
    order = np.argsort(crossings.along_m)
    half_m = np.sqrt(0.06**2 - OFF_M**2 - 0.001**2)
    np.testing.assert_allclose(crossings.along_m[order], [0.14 - half_m, 0.14 + half_m], atol=FACET_M)
    assert crossings.sign[order].tolist() == [-1, 1]
    assert crossings.ray.tolist() == [0, 0]


def test_rays_that_miss_cross_nothing(rays, data) -> None:
    crossings = rays.crossings(data, ABOVE_M, -DOWN, of="organ")
    assert [len(values) for values in crossings] == [0, 0, 0]


def test_the_winding_number_counts_the_bodies_about_a_point(rays, data, ball_anatomy) -> None:
    """Two tumours nest, and a third overlaps both."""
    origin_m, ranges_m = np.array([0.504, 0.001, 0.2]), np.linspace(0.0, 0.25, 501)[None]
    winding = rays.winding(data, origin_m, DOWN, ranges_m, of="tumour")[0]
    points_m = origin_m + ranges_m[0, :, None] * DOWN
    count = np.sum([tumour.contains(points_m) for tumour in ball_anatomy.tumours], axis=0)
    assert winding.tolist() == count.tolist()
    assert set(winding) == {0, 1, 2, 3}


def test_a_ray_that_starts_inside_knows_it(rays, data) -> None:
    inside_m = np.array([0.5 + OFF_M, 0.001, 0.06])
    winding = rays.winding(data, inside_m, DOWN, np.array([[0.0, 0.05, 0.07]]), of="organ")
    assert winding.tolist() == [[1, 1, 0]]


def test_a_class_without_bodies_winds_about_nothing(rays, data) -> None:
    assert not rays.winding(data, ABOVE_M, DOWN, np.array([[0.1, 0.14]]), of="target").any()


def test_an_unknown_surface_is_refused_with_those_that_exist(rays, data) -> None:
    with pytest.raises(ValueError, match="of='bone': choose one of organ, tumour, target"):
        rays.crossings(data, ABOVE_M, DOWN, of="bone")

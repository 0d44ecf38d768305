"""The surface under one moving point: exact at smooth places and at sharp rims, whatever was asked before."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from sim.episode.scenario import SCENARIOS
from sim.episode.setup import placed_organ
from sim.world.motion.contact_surface import ContactSurface
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance, closest_points_on_triangles
from sim.world.solids.triangle_patch import TrianglePatch


@pytest.fixture(scope="module", params=["sphere", "liver"])
def organ(request) -> Solid:
    return placed_organ(SCENARIOS[request.param])[0].organ


@pytest.fixture(scope="module")
def surface(organ) -> ContactSurface:
    return ContactSurface(organ)


@pytest.fixture(scope="module")
def reference(organ) -> SurfaceDistance:
    return SurfaceDistance(organ)


def near_points(organ: Solid, *, n: int, is_rim: bool, rng: np.random.Generator) -> np.ndarray:
    """Points within some millimetres of the surface, or of edges that its triangles fold about by over 40 degrees."""
    if is_rim:
        mesh = organ.to_trimesh()
        edges = mesh.face_adjacency_edges[mesh.face_adjacency_angles > np.deg2rad(40.0)]
        ends_m = organ.vertices_m[edges[rng.integers(len(edges), size=n)]]
        share = rng.uniform(size=(n, 1))
        on_surface_m = ends_m[:, 0] + share * (ends_m[:, 1] - ends_m[:, 0])
    else:
        weights = rng.dirichlet(np.ones(3), size=n)
        corners_m = organ.vertices_m[organ.faces[rng.integers(len(organ.faces), size=n)]]
        on_surface_m = np.einsum("nc,ncd->nd", weights, corners_m)
    return on_surface_m + rng.normal(size=(n, 3)) * 0.002


@pytest.mark.parametrize("is_rim", [False, True])
def test_distances_and_sides_are_those_of_the_whole_surface(organ, surface, reference, is_rim) -> None:
    points_m = near_points(organ, n=150, is_rim=is_rim, rng=np.random.default_rng(0))
    answers = [surface.signed_distance_and_normal(point_m) for point_m in points_m]
    distance_m = np.array([distance for distance, _ in answers])
    expected_m = reference.signed_distance_m(points_m)
    assert 20 < (expected_m < 0.0).sum() < 130
    # The reference looks at the triangles of the six nearest pieces, which may miss the closest by some micrometres.
    np.testing.assert_allclose(distance_m, expected_m, atol=1e-5)
    corners_m = organ.vertices_m[organ.faces]
    for point_m, (distance, _) in zip(points_m[:5], answers, strict=False):
        closest_m = closest_points_on_triangles(np.tile(point_m, (len(corners_m), 1)), corners_m)
        assert abs(distance) == pytest.approx(np.linalg.norm(closest_m - point_m, axis=1).min(), abs=1e-12)


def test_the_normal_leads_from_the_surface_out_of_the_organ(organ, surface, reference) -> None:
    points_m = near_points(organ, n=60, is_rim=True, rng=np.random.default_rng(1))
    for point_m in points_m:
        distance_m, outward = surface.signed_distance_and_normal(point_m)
        assert np.linalg.norm(outward) == pytest.approx(1.0, abs=1e-9)
        foot_m = point_m - distance_m * outward
        assert reference.distance_to_triangles_m(foot_m[None])[0] < 1e-9
        step_m = 0.5 * abs(distance_m)  # towards the foot the distance falls by just the way gone
        nearer_m, _ = surface.signed_distance_and_normal(point_m - np.sign(distance_m) * step_m * outward)
        assert nearer_m == pytest.approx(np.sign(distance_m) * step_m, abs=1e-9)


def test_no_answer_depends_on_what_was_asked_before(organ, surface) -> None:
    """A walk about a sharp rim, with rests and leaps: each answer is that of a surface never asked before."""
    rng = np.random.default_rng(2)
    start_m, other_m = near_points(organ, n=2, is_rim=True, rng=rng)
    walk_m = np.cumsum(rng.normal(size=(120, 3)) * 0.0004, axis=0) + start_m
    walk_m[40:44], walk_m[70] = walk_m[40], other_m
    fresh = ContactSurface(organ)
    for point_m in walk_m:
        distance_m, outward = surface.signed_distance_and_normal(point_m)
        fresh._patch, fresh._ball_radius_m = None, 0.0
        expected_m, expected = fresh.signed_distance_and_normal(point_m)
        assert distance_m == pytest.approx(expected_m, abs=1e-12)
        np.testing.assert_allclose(outward, expected, atol=1e-6)


def test_the_clearance_is_never_too_large_and_nothing_inside(organ, surface, reference) -> None:
    rng = np.random.default_rng(3)
    low_m, high_m = organ.bounds_m
    points_m = rng.uniform(low_m - 0.02, high_m + 0.02, (150, 3))
    exact_m = reference.signed_distance_m(points_m)
    clearance_m = np.array([surface.clearance_m(point_m) for point_m in points_m])
    is_inside = exact_m < 0.0
    assert 10 < is_inside.sum() < 140
    np.testing.assert_array_equal(clearance_m[is_inside], 0.0)
    assert (clearance_m <= np.maximum(exact_m, 0.0) + 1e-4).all()  # the reference is good to 0.1 mm from afar
    assert (clearance_m[~is_inside] >= exact_m[~is_inside] - 0.0015).all()


def test_a_wedge_is_as_sharp_as_it_was_made() -> None:
    """20 degrees between two planes, the edge along y through the origin: depth and normal by hand."""
    half_rad = np.deg2rad(10.0)
    x_m, z_m = 0.1 * np.cos(half_rad), 0.1 * np.sin(half_rad)
    corners_m = [[x, y, z] for y in (-0.05, 0.05) for x, z in ((0.0, 0.0), (x_m, z_m), (x_m, -z_m))]
    wedge = Solid.from_trimesh(trimesh.convex.convex_hull(np.array(corners_m)))
    surface = ContactSurface(wedge)
    for depth_m in (0.001, 0.003, 0.01):
        distance_m, _ = surface.signed_distance_and_normal(np.array([depth_m, 0.0, 0.0]))
        assert distance_m == pytest.approx(-depth_m * np.sin(half_rad), abs=1e-12)
        point_m = np.array([depth_m, 0.0, 0.1 * depth_m])
        distance_m, outward = surface.signed_distance_and_normal(point_m)
        upper = np.array([-np.sin(half_rad), 0.0, np.cos(half_rad)])
        assert distance_m == pytest.approx(point_m @ upper, abs=1e-12)
        np.testing.assert_allclose(outward, upper, atol=1e-9)
        distance_m, outward = surface.signed_distance_and_normal(np.array([-depth_m, 0.0, 0.0]))
        assert distance_m == pytest.approx(depth_m, abs=1e-12)
        np.testing.assert_allclose(outward, [-1.0, 0.0, 0.0], atol=1e-9)
    distance_m, outward = surface.signed_distance_and_normal(
        np.array([0.05 * np.cos(half_rad), 0, 0.05 * np.sin(half_rad)])
    )
    assert distance_m == pytest.approx(0.0, abs=1e-9)
    assert outward[2] > 0.9


def test_patches_agree_with_the_closest_points_of_many_triangles_slivers_among_them() -> None:
    rng = np.random.default_rng(4)
    corners_m = rng.normal(size=(40, 3, 3))
    corners_m[0, 2] = corners_m[0, 1]  # a triangle without area
    corners_m[1] = corners_m[1, 0]  # and one that is a point
    corners_m[2, 2] = corners_m[2, :2].mean(axis=0) + 1e-9
    for rows in (slice(None), slice(0, 1), slice(1, 2), slice(2, 3), slice(3, 4)):
        patch = TrianglePatch(corners_m[rows])
        for point_m in 2.0 * rng.normal(size=(40, 3)):
            n = len(corners_m[rows])
            expected_m = closest_points_on_triangles(np.tile(point_m, (n, 1)), corners_m[rows])
            closest_m, row, distance_m = patch.closest(point_m)
            assert distance_m == pytest.approx(np.linalg.norm(expected_m - point_m, axis=1).min(), abs=1e-8)
            np.testing.assert_allclose(closest_m, expected_m[row], atol=1e-6)
            assert np.linalg.norm(closest_m - point_m) == pytest.approx(distance_m, abs=1e-8)

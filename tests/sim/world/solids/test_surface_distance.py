import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance, closest_points_on_triangles, strew_points


@pytest.fixture(scope="module")
def wedge():
    """A solid with sharp edges and long thin triangles."""
    mesh = trimesh.convex.convex_hull(
        [[0, 0, 0], [0.12, 0, 0], [0, 0.08, 0], [0.12, 0.08, 0], [0, 0.04, 0.05], [0.02, 0.04, 0.06]]
    )
    return Solid.from_trimesh(mesh)


@pytest.fixture(scope="module")
def ball():
    return Solid.from_trimesh(trimesh.creation.icosphere(subdivisions=5, radius=0.05))


def test_closest_points_of_triangles_agree_with_trimesh():
    rng = np.random.default_rng(0)
    corners, points = rng.normal(size=(500, 3, 3)), rng.normal(scale=2.0, size=(500, 3))
    expected = trimesh.triangles.closest_point(corners, points)
    assert closest_points_on_triangles(points, corners) == pytest.approx(expected, abs=1e-9)


def test_the_closest_point_of_a_triangle_without_area_is_on_its_longest_edge():
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    assert closest_points_on_triangles(np.array([[1.5, 1.0, 0.0]]), corners)[0] == pytest.approx([1.5, 0, 0])


def test_strewn_points_lie_on_the_surface_and_leave_no_gap(wedge):
    points = strew_points(wedge, 0.002)
    assert trimesh.proximity.closest_point(wedge.to_trimesh(), points[::20])[1].max() < 1e-12
    on_surface, _ = trimesh.sample.sample_surface(wedge.to_trimesh(), 3000, seed=0)
    clearances = KDTree(points).query(on_surface)[0]
    # Edges of at most 2 mm: a circumradius of at most 1.16 mm, or an obtuse triangle, within 1 mm of one.
    assert clearances.max() <= 0.002 / np.sqrt(3.0) + 1e-9


def test_signed_distance_agrees_with_trimesh_within_a_tenth_of_a_millimetre(wedge):
    points = np.random.default_rng(1).uniform([-0.05] * 3, [0.17, 0.13, 0.11], size=(1500, 3))
    expected = -trimesh.proximity.signed_distance(wedge.to_trimesh(), points)
    assert SurfaceDistance(wedge).signed_distance_m(points) == pytest.approx(expected, abs=1e-4)


def test_distance_to_a_ball_is_the_radius_less(ball):
    points = np.random.default_rng(2).uniform(-0.1, 0.1, size=(2000, 3))
    expected = np.linalg.norm(points, axis=1) - 0.05
    # The facets lie up to 0.03 mm inside the sphere; the lookup adds at most 0.1 mm.
    assert SurfaceDistance(ball).signed_distance_m(points) == pytest.approx(expected, abs=1.3e-4)


def test_the_grid_is_exact_at_its_nodes_near_the_surface(wedge):
    grid = DistanceGrid.from_solid(wedge, margin_m=0.02)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in grid.values_m.shape], indexing="ij"), -1).reshape(
        -1, 3
    )
    index = index[np.abs(grid.values_m.ravel()) < 0.010][::7]
    nodes = grid.origin_m + grid.spacing_m * index
    expected = -trimesh.proximity.signed_distance(wedge.to_trimesh(), nodes)
    assert grid.values_m[tuple(index.T)] == pytest.approx(expected, abs=1e-4)
    assert grid.distance_m(nodes) == pytest.approx(grid.values_m[tuple(index.T)], abs=1e-12)


def test_the_grid_interpolates_a_ball(ball):
    grid = DistanceGrid.from_solid(ball)
    points = np.random.default_rng(3).uniform(-0.085, 0.085, size=(4000, 3))
    radius = np.linalg.norm(points, axis=1)
    points, radius = points[radius > 0.02], radius[radius > 0.02]
    distance = grid.distance_m(points)
    is_near = np.abs(radius - 0.05) < 0.008
    # Trilinear error: spacing^2 / 8 x two curvatures 1 / r at r >= 42 mm is 0.1 mm; 0.1 mm at the nodes.
    assert distance[is_near] == pytest.approx(radius[is_near] - 0.05, abs=2e-4)
    assert distance == pytest.approx(radius - 0.05, abs=1.2e-3)  # farther nodes may be too far by 1 mm


def test_beyond_the_lattice_the_distance_is_a_lower_bound_and_not_idle(ball):
    grid = DistanceGrid.from_solid(ball, margin_m=0.02)
    directions = np.random.default_rng(5).normal(size=(500, 3))
    points = 0.3 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    bound = grid.distance_m(points)
    assert (bound <= 0.25 + 1e-3).all()  # nodes far from the surface may be too far by up to 1 mm
    # Towards the box's corner, 0.121 m from the middle, 0.071 m from the ball: hypot(0.179, 0.071) = 0.192.
    assert (bound >= 0.19).all()


def test_a_spacing_of_zero_is_refused(ball):
    with pytest.raises(ValueError, match="spacing_m=0"):
        DistanceGrid.from_solid(ball, spacing_m=0)

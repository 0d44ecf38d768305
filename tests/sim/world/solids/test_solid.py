import numpy as np
import pytest
import trimesh

from sim.world.errors import MeshError
from sim.world.solids.solid import Solid


def ball(radius_m=0.05, subdivisions=3):
    return Solid.from_trimesh(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_m))


def torus():
    return Solid.from_trimesh(trimesh.creation.torus(0.05, 0.02))


def lattice(low, high, n):
    ticks = [np.linspace(low[i], high[i], n) for i in range(3)]
    return np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("solid", [ball(), torus()], ids=["ball", "torus"])
def test_inside_agrees_with_trimesh_on_random_points(solid):
    rng = np.random.default_rng(0)
    low, high = solid.bounds_m
    points = rng.uniform(low - 0.01, high + 0.01, size=(5000, 3))
    assert np.array_equal(solid.contains(points), solid.to_trimesh().contains(points))


def test_rays_through_edges_and_vertices_of_a_box_are_counted_once():
    # The lattice hits the box's vertices, its edges and the diagonals of its faces exactly.
    box = Solid.from_trimesh(trimesh.creation.box((0.1, 0.1, 0.1)))
    points = lattice([-0.06] * 3, [0.06] * 3, 25)
    winding = box.winding(points)
    assert set(np.unique(winding)) <= {0, 1}
    distance_to_faces = 0.05 - np.abs(points).max(axis=1)
    assert (winding[distance_to_faces > 1e-6] == 1).all()  # the rays are moved by less than 1e-6 m
    assert (winding[distance_to_faces < -1e-6] == 0).all()


def test_overlapping_bodies_count_twice_and_are_inside():
    one, other = (trimesh.creation.icosphere(radius=0.05) for _ in range(2))
    other.apply_translation([0.05, 0.0, 0.0])
    solid = Solid.from_trimesh(trimesh.util.concatenate([one, other]))
    points = np.array([[0.025, 0.0, 0.001], [-0.03, 0.0, 0.001], [0.08, 0.0, 0.001], [0.2, 0.0, 0.0]])
    assert solid.winding(points).tolist() == [2, 1, 1, 0]
    assert solid.contains(points).tolist() == [True, True, True, False]


def test_a_cavity_is_outside_and_an_inverted_ball_has_negative_winding():
    outer = trimesh.creation.icosphere(radius=0.05)
    cavity = trimesh.creation.icosphere(radius=0.02)
    cavity.invert()
    hollow = Solid.from_trimesh(trimesh.util.concatenate([outer, cavity]))
    assert hollow.winding(np.array([[0.001, 0.002, 0.0], [0.03, 0.001, 0.0]])).tolist() == [0, 1]
    assert Solid.from_trimesh(cavity).winding(np.array([[0.001, 0.002, 0.0]])).tolist() == [-1]


def test_volume_and_area_of_a_box_and_of_a_fine_ball():
    box = Solid.from_trimesh(trimesh.creation.box((0.1, 0.2, 0.3)))
    assert box.volume_m3 == pytest.approx(0.006, rel=1e-12)
    assert box.area_m2 == pytest.approx(0.22, rel=1e-12)
    # An icosphere of 20,480 facets lies inside its ball by 0.1 % in volume.
    assert ball(0.05, 5).volume_m3 == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=2e-3)


def test_samples_are_inside_and_even_in_volume():
    rng = np.random.default_rng(1)
    points = ball(0.05, 4).sample_inside(20000, rng)
    assert points.shape == (20000, 3)
    radius = np.linalg.norm(points, axis=1) / 0.05
    # In a ball r^3 is uniform with mean 1/2, and octants hold an eighth each: five standard errors of 20,000.
    assert np.mean(radius**3) == pytest.approx(0.5, abs=5 * np.sqrt(1 / 12 / 20000) + 2e-3)
    octants = np.bincount((points > 0) @ [1, 2, 4], minlength=8) / 20000
    assert octants == pytest.approx(np.full(8, 0.125), abs=5 * np.sqrt(0.125 * 0.875 / 20000))


def test_sampling_repeats_with_the_seed():
    draws = [ball().sample_inside(50, np.random.default_rng(7)) for _ in range(2)]
    assert np.array_equal(*draws)


def test_top_height_is_the_upper_hemisphere():
    solid = ball(0.05, 5)
    places = np.array([[0.0, 0.0], [0.03, 0.0], [0.0, -0.04], [0.06, 0.0]])
    height = solid.top_height_m(places)
    # Facets of 20,480 triangles are at most 0.03 mm below the sphere.
    assert height[:3] == pytest.approx([0.05, 0.04, 0.03], abs=1e-4)
    assert np.isnan(height[3])


def test_a_place_under_an_overhang_is_not_open_above():
    low = trimesh.creation.box((0.1, 0.1, 0.02))
    roof = trimesh.creation.box((0.05, 0.1, 0.02))
    roof.apply_translation([0.025, 0.0, 0.06])
    solid = Solid.from_trimesh(trimesh.util.concatenate([low, roof]))
    points = np.array([[-0.03, 0.01, 0.0101], [0.03, 0.01, 0.0101], [0.03, 0.01, 0.08]])
    assert solid.is_open_above(points).tolist() == [True, False, True]


def test_a_rigid_motion_moves_the_inside_with_it():
    turn = trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 0.5], [0.1, 0.2, 0.3])
    points = np.random.default_rng(2).uniform(-0.07, 0.07, size=(2000, 3))
    moved = torus().transformed(turn)
    assert np.array_equal(moved.contains(points @ turn[:3, :3].T + turn[:3, 3]), torus().contains(points))
    assert moved.volume_m3 == pytest.approx(torus().volume_m3, rel=1e-9)


def test_the_arrays_are_copies_and_frozen():
    vertices = np.array(trimesh.creation.box().vertices)
    solid = Solid(vertices, trimesh.creation.box().faces)
    vertices[0] = 99.0
    assert solid.vertices_m.max() == 0.5
    with pytest.raises(ValueError, match="read-only"):
        solid.vertices_m[0] = 1.0


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros((4, 2)), np.zeros((4, 3), int), "vertices_m has shape"),
        (np.zeros((4, 3)), np.zeros((2, 3), int), "faces has shape"),
        (np.full((4, 3), np.nan), np.zeros((4, 3), int), "not finite"),
        (np.zeros((4, 3)), np.full((4, 3), 4), r"faces index 4\.\.4, but there are 4"),
    ],
)
def test_arrays_that_are_no_solid_are_refused(vertices, faces, message):
    with pytest.raises(MeshError, match=message):
        Solid(vertices, faces)


def test_points_of_another_shape_or_not_finite_are_refused():
    with pytest.raises(ValueError, match=r"shape \(3,\), expected \(N, 3\)"):
        ball().contains(np.zeros(3))
    with pytest.raises(ValueError, match="not finite"):
        ball().contains([[0.0, np.nan, 0.0]])
    assert ball().contains(np.empty((0, 3))).shape == (0,)


def test_a_flat_solid_has_nothing_to_sample():
    sheet = Solid([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [0, 2, 1], [1, 3, 2], [1, 2, 3]])
    with pytest.raises(MeshError, match="no interior"):
        sheet.sample_inside(10, np.random.default_rng(0))


def test_a_grid_asked_by_columns_lies_inside_where_its_points_do() -> None:
    """Two balls that overlap, one of them inside out, so that winding numbers of 2, 1, 0 and -1 all come up."""
    parts = [trimesh.creation.icosphere(subdivisions=2, radius=0.01) for _ in range(3)]
    parts[1].apply_translation((0.008, 0.0, 0.004))
    parts[2].apply_translation((-0.012, 0.001, 0.0))
    parts[2].invert()
    mesh = trimesh.util.concatenate(parts)
    solid = Solid(mesh.vertices, mesh.faces)
    x, z = np.linspace(-0.025, 0.025, 23), np.linspace(-0.015, 0.02, 31)
    places = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.column_stack([np.repeat(places, len(z), axis=0), np.tile(z, len(places))])
    by_points = solid.contains(points)
    assert set(solid.winding(points).tolist()) >= {-1, 0, 1, 2}
    assert np.array_equal(solid.contains_in_columns(places, z).ravel(), by_points)

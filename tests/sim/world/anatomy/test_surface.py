import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from sim.world.anatomy.surface import (
    SensingSurface,
    fit_normals,
    held_to_tilt,
    thin_to_spacing,
    upper_surface_workspace,
)
from sim.world.errors import MeshError
from sim.world.solids.solid import Solid


@pytest.fixture(scope="module")
def ball():
    return Solid.from_trimesh(trimesh.creation.icosphere(subdivisions=4, radius=0.08))


@pytest.fixture(scope="module")
def workspace(ball):
    return upper_surface_workspace(ball, 2000, rng=np.random.default_rng(0))


def test_the_cap_of_a_ball_is_covered_to_its_tilt_and_no_further(workspace):
    tilt = np.rad2deg(np.arccos(workspace.positions_m[:, 2] / np.linalg.norm(workspace.positions_m, axis=1)))
    # Facets of 5,120 triangles reach up to 3 degrees from their middle.
    assert tilt.max() == pytest.approx(60.0, abs=3.0)
    # Even in area means even in height between cos 60 = 0.5 and 1: mean 0.75, five standard errors of 2,000.
    height = workspace.positions_m[:, 2] / 0.08
    assert height.mean() == pytest.approx(0.75, abs=5 * 0.5 / np.sqrt(12 * 2000))


def test_normals_of_a_ball_point_to_its_middle(workspace):
    radial = -workspace.positions_m / np.linalg.norm(workspace.positions_m, axis=1, keepdims=True)
    angle = np.rad2deg(np.arccos(np.clip(np.einsum("ij,ij->i", radial, workspace.normals), -1, 1)))
    # Neighbours reach 4 mm on a radius of 80 mm (3 degrees); at the cap's border they lie on one side only.
    assert np.quantile(angle, 0.9) < 1.5
    assert angle.max() < 5.0


def test_positions_are_about_as_many_as_asked_and_keep_apart(workspace):
    assert workspace.n_poses == pytest.approx(2000, rel=0.05)
    nearest = KDTree(workspace.positions_m).query(workspace.positions_m, k=2)[0][:, 1]
    # Random points would have a nearest neighbour at 0.5 of the mean spacing, some at 0.01 of it.
    area = 2 * np.pi * 0.08**2 * 0.5
    assert nearest.min() > 0.7 * np.sqrt(area / 2000)
    assert nearest.max() < 2.0 * np.sqrt(area / 2000)


def test_what_the_organ_itself_covers_is_left_out():
    floor = trimesh.creation.box((0.2, 0.2, 0.02))
    roof = trimesh.creation.box((0.1, 0.2, 0.02))
    roof.apply_translation([0.05, 0.0, 0.08])
    solid = Solid.from_trimesh(trimesh.util.concatenate([floor, roof]))
    workspace = upper_surface_workspace(solid, 1000, rng=np.random.default_rng(1))
    on_floor = workspace.positions_m[workspace.positions_m[:, 2] < 0.05]
    assert on_floor[:, 0].max() <= 0.0 + 1e-6
    assert len(on_floor) == pytest.approx(workspace.n_poses / 2, rel=0.1)
    assert workspace.normals == pytest.approx(np.tile([0.0, 0.0, -1.0], (workspace.n_poses, 1)), abs=1e-9)


def test_the_same_seed_gives_the_same_positions(ball, workspace):
    again = upper_surface_workspace(ball, 2000, rng=np.random.default_rng(0))
    assert np.array_equal(again.positions_m, workspace.positions_m)
    assert np.array_equal(again.normals, workspace.normals)


def test_thinning_keeps_a_maximal_set():
    points = np.random.default_rng(2).uniform(size=(2000, 3)) * [1.0, 1.0, 0.0]
    kept = points[thin_to_spacing(points, 0.05)]
    assert KDTree(kept).query_pairs(0.05) == set()
    assert KDTree(kept).query(points)[0].max() <= 0.05  # nothing could be added


def test_a_plane_is_fitted_exactly_and_signed():
    rng = np.random.default_rng(3)
    normal = np.array([1.0, 2.0, 2.0]) / 3.0
    points = rng.normal(size=(50, 3))
    points -= np.outer(points @ normal, normal)
    for sign in (1.0, -1.0):
        fitted = fit_normals(points, np.tile(sign * normal, (50, 1)))
        assert fitted == pytest.approx(np.tile(sign * normal, (50, 1)), abs=1e-9)


def test_a_rigid_motion_turns_normals_without_moving_them(workspace):
    T = trimesh.transformations.rotation_matrix(0.5, [1, 0, 0])
    T[:3, 3] = [0.5, 0.1, 0.2]
    moved = workspace.transformed(T)
    assert moved.positions_m == pytest.approx(workspace.positions_m @ T[:3, :3].T + T[:3, 3])
    assert moved.normals == pytest.approx(workspace.normals @ T[:3, :3].T)


def test_arguments_out_of_range_are_refused(ball):
    with pytest.raises(ValueError, match="n_poses=5 must be at least 11"):
        upper_surface_workspace(ball, 5, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="max_tilt_rad=2"):
        upper_surface_workspace(ball, 100, rng=np.random.default_rng(0), max_tilt_rad=2)
    with pytest.raises(ValueError, match="normals has shape"):
        SensingSurface(np.zeros((3, 3)), np.zeros((2, 3)))
    with pytest.raises(ValueError, match="grid_shape"):
        SensingSurface(np.zeros((3, 3)), np.zeros((3, 3)), (2, 2))


def test_a_spike_without_upward_faces_has_no_workspace():
    spike = trimesh.creation.cone(0.01, 0.3, sections=12)
    with pytest.raises(MeshError, match="no face points up within 60 degrees"):
        upper_surface_workspace(Solid.from_trimesh(spike), 100, rng=np.random.default_rng(0))


def knobbly_ball():
    """A ball with waves of some millimetres, as outlines of thick slices have."""
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.08)
    waves = np.sin(mesh.vertices * 2 * np.pi / 0.02).prod(axis=1)
    return Solid(mesh.vertices * (1.0 + 0.08 * waves[:, None]), mesh.faces)


def test_no_beam_is_steeper_than_the_limit_after_planes_are_fitted():
    knobbly, rng = knobbly_ball(), np.random.default_rng(0)
    workspace = upper_surface_workspace(knobbly, 2000, rng=rng)
    tilt_rad = np.arccos(-workspace.normals[:, 2])
    assert np.rad2deg(tilt_rad.max()) <= 60.0 + 1e-9  # rounding
    # Some planes were steeper: fitted anew to what is left, many positions go beyond.
    assert 1000 < workspace.n_poses < 0.95 * 2000
    lengths = np.linalg.norm(workspace.normals, axis=1)
    assert lengths == pytest.approx(np.ones(workspace.n_poses), abs=1e-12)


def test_poses_within_the_limit_are_left_as_they_are():
    normals = np.array([[0.0, 0.0, -1.0], [np.sin(1.0), 0.0, -np.cos(1.0)]])
    held, is_kept = held_to_tilt(normals, np.deg2rad(60.0))
    assert is_kept.all()
    assert (held == normals).all()


def test_a_plane_a_little_too_steep_leans_back_and_an_overhanging_one_is_dropped():
    angles = np.deg2rad([60.5, 62.0, 100.0])
    normals = np.stack([np.sin(angles), np.zeros(3), -np.cos(angles)], axis=1)
    held, is_kept = held_to_tilt(normals, np.deg2rad(60.0))
    assert is_kept.tolist() == [True, False, False]
    assert held[0] == pytest.approx([np.sin(np.pi / 3), 0.0, -0.5], abs=1e-12)


def test_a_surface_of_nothing_but_steep_planes_is_refused_with_a_remedy():
    spikes = trimesh.creation.box((0.004, 0.004, 0.2))
    spikes.vertices[spikes.vertices[:, 2] > 0, :2] *= 0.9
    with pytest.raises(MeshError, match="smooth the mesh, turn the organ"):
        upper_surface_workspace(Solid.from_trimesh(comb(spikes)), 60, rng=np.random.default_rng(0))


def comb(tooth):
    """Teeth side by side, narrower than the distance between poses, on top of one another's rims."""
    teeth = [tooth.copy().apply_translation([0.006 * i, 0.0, 0.03 * (i % 2)]) for i in range(40)]
    return trimesh.util.concatenate(teeth)

"""Readings of a sweep: on its planes, in the organ, seen, labelled as the solids say, and the same each time."""

import dataclasses

import numpy as np
import pytest
import trimesh

from planner import Workspace
from sim.episode.positioner import FreePositioner
from sim.errors import FieldError
from sim.world.anatomy.structures import Structure
from sim.world.scene.scene import build_scene
from sim.world.sensing.sensor import SceneState
from sim.world.sensing.ultrasound.convex_array import ConvexArray
from sim.world.sensing.ultrasound.settings import Settings
from sim.world.sensing.ultrasound.ultrasound_sensor import TissueChoice, UltrasoundSensor
from sim.world.solids.solid import Solid

POSES = Workspace(
    np.array([[0.5, 0.0, 0.12], [0.52, 0.01, 0.1157], [0.5, 0.0, 0.20]]),
    np.array([[0.0, 0.0, -1.0], [-0.6, 0.0, -0.8], [0.0, 0.0, -1.0]]),
)
SMALL = UltrasoundSensor(
    array=ConvexArray(n_lines=64, n_samples=256), settings=Settings(n_pixels=64), n_planes=5, n_points=1200
)


def state_of(anatomy, cone, pose=0):
    scene = build_scene(anatomy, cone, arm=None)
    data = scene.new_data()
    FreePositioner(scene, POSES).place(data, pose, is_lifted=False)
    return SceneState(scene, data)


def rib(*, z_m: float, name: str = "rib") -> Structure:
    """A bar along y above the tumours, 12 mm thick."""
    mesh = trimesh.creation.box((0.012, 0.08, 0.006))
    mesh.apply_translation((0.5, 0.0, z_m))
    return Structure(name=name, solid=Solid.from_trimesh(mesh))


@pytest.fixture(scope="module")
def reading(ball_anatomy, cone):
    return SMALL.sense(state_of(ball_anatomy, cone), np.random.default_rng(0))


def test_points_lie_on_the_planes_of_the_sweep(reading, cone):
    sweep = reading.images
    for plane in range(5):
        points_m = reading.points_m[sweep.planes == plane]
        T = sweep.T_world_planes[plane]
        in_plane_m = (points_m - T[:3, 3]) @ T[:3, :3]
        np.testing.assert_allclose(in_plane_m[:, 1], 0.0, atol=1e-12)
        # Between the face's arc and the depth of the cone.
        depth_m = np.hypot(in_plane_m[:, 0], in_plane_m[:, 2] + 0.025) - 0.025
        assert depth_m.min() >= 0.0
        assert depth_m.max() <= cone.depth_m
        # The last points lie well beside the cone's: the face has a width.
        assert np.abs(in_plane_m[:, 0]).max() > cone.depth_m * np.tan(cone.half_angle_rad)


def test_the_planes_are_rocked_about_the_tip_through_the_cone(reading, cone):
    sweep = reading.images
    np.testing.assert_allclose(sweep.T_world_planes[:, :3, 3], np.tile([0.5, 0.0, 0.12], (5, 1)), atol=1e-12)
    beams = sweep.T_world_planes[:, :3, 2]
    angles = np.arccos(-beams[:, 2])
    expected = cone.half_angle_rad * np.abs(np.linspace(-1.0, 1.0, 5))
    np.testing.assert_allclose(angles, expected, atol=1e-7)
    assert beams[0] @ beams[-1] == pytest.approx(np.cos(2.0 * cone.half_angle_rad))


def test_labels_are_those_of_the_solids_and_all_points_lie_in_the_organ(reading, ball_anatomy):
    assert ball_anatomy.organ.contains(reading.points_m).all()
    inside = np.zeros(len(reading.points_m), bool)
    for tumour in ball_anatomy.tumours:
        inside |= trimesh.Trimesh(tumour.vertices_m, tumour.faces).contains(reading.points_m)
    assert np.array_equal(reading.is_occupied, inside)
    assert 30 < inside.sum() < len(inside) - 100


def test_tissue_just_below_the_capsule_is_seen_over_the_width_of_the_face(reading):
    just_below = reading.points_m[(reading.points_m[:, 2] > 0.105)]
    assert len(just_below) > 20
    assert np.ptp(just_below[:, 0]) > 0.02


def test_the_same_seed_gives_the_same_bytes_and_another_seed_other_points(ball_anatomy, cone, reading):
    state = state_of(ball_anatomy, cone)
    again = SMALL.sense(state, np.random.default_rng(0))
    assert again.points_m.tobytes() == reading.points_m.tobytes()
    assert again.images.images.tobytes() == reading.images.images.tobytes()
    other = SMALL.sense(state, np.random.default_rng(1))
    assert other.points_m.tobytes() != reading.points_m.tobytes()


@pytest.mark.parametrize("name", ["rib", "gas", "calcification 2"])
def test_behind_what_stops_sound_there_are_no_points_rather_than_free_ones(ball_anatomy, cone, reading, name):
    hidden = dataclasses.replace(ball_anatomy, structures=(rib(z_m=0.11, name=name),))
    shadowed = SMALL.sense(state_of(hidden, cone), np.random.default_rng(0))

    def n_behind(points_m):
        return int(((np.abs(points_m[:, 0] - 0.5) < 0.004) & (points_m[:, 2] < 0.105)).sum())

    assert n_behind(reading.points_m) > 20
    assert n_behind(shadowed.points_m) == 0
    # Beside it all is as before.
    beside = reading.points_m[np.abs(reading.points_m[:, 0] - 0.5) > 0.035]
    kept = {tuple(point) for point in shadowed.points_m}
    assert len(beside) > 20
    assert all(tuple(point) in kept for point in beside)


def test_a_structure_that_names_no_tissue_hides_nothing_and_a_tissue_can_be_given(
    ball_anatomy, cone, reading
):
    plain = dataclasses.replace(ball_anatomy, structures=(rib(z_m=0.11, name="thing"),))
    seen = SMALL.sense(state_of(plain, cone), np.random.default_rng(0))
    assert np.array_equal(seen.points_m, reading.points_m)
    told = dataclasses.replace(SMALL, tissues=TissueChoice(structures=(("thing", "bone"),)))
    assert len(told.sense(state_of(plain, cone), np.random.default_rng(0)).points_m) < len(seen.points_m)


def test_a_tissue_for_a_structure_that_is_not_there_is_refused(ball_anatomy, cone):
    told = dataclasses.replace(SMALL, tissues=TissueChoice(structures=(("rip", "bone"),)))
    there = dataclasses.replace(ball_anatomy, structures=(rib(z_m=0.11),))
    with pytest.raises(FieldError, match="structure_tissue=rip: the structures here are rib"):
        told.sense(state_of(there, cone), np.random.default_rng(0))
    with pytest.raises(FieldError, match="structure_tissue=rip: there are no structures here"):
        told.sense(state_of(ball_anatomy, cone), np.random.default_rng(0))


def test_a_probe_without_contact_sees_nothing(ball_anatomy, cone):
    assert len(SMALL.sense(state_of(ball_anatomy, cone, pose=2), np.random.default_rng(0)).points_m) == 0


def test_nothing_returns_from_beyond_the_depth_that_the_energy_reaches(ball_anatomy, cone):
    state = state_of(ball_anatomy, cone)
    shallow = dataclasses.replace(SMALL, seen_db=20.0).sense(state, np.random.default_rng(0))
    # 20 dB at 0.5 dB/cm/MHz and 3.5 MHz, there and back, are 57 mm of liver, behind up to 6 mm of gel, and the ends of
    # the face lie 13 mm beside the tip.
    assert np.linalg.norm(shallow.points_m - [0.5, 0.0, 0.12], axis=1).max() < 0.068
    assert len(shallow.points_m) > 50


def test_a_tumour_shows_in_the_pictures_where_its_points_are(ball_anatomy, cone):
    sensor = dataclasses.replace(
        SMALL,
        settings=Settings(n_pixels=256),
        array=ConvexArray(),
        tissues=TissueChoice(tumour="hyperechoic"),
    )
    found = sensor.sense(state_of(ball_anatomy, cone), np.random.default_rng(0))
    sweep, bright = found.images, {True: [], False: []}
    for plane in range(5):
        on_plane = sweep.planes == plane
        at = sweep.pixels(found.points_m[on_plane], plane).round().astype(int)
        values = sweep.images[plane][np.clip(at[:, 0], 0, 255), np.clip(at[:, 1], 0, 255)]
        for is_tumour in (True, False):
            bright[is_tumour] += values[found.is_occupied[on_plane] == is_tumour].tolist()
    # 7 dB of 60 are 30 of 255 levels; a point of speckle deviates by 5.6 dB, some hundred points by 0.5 dB.
    assert np.mean(bright[True]) - np.mean(bright[False]) > 18.0


def test_a_second_class_is_labelled_too(ball_anatomy, cone):
    target = dataclasses.replace(ball_anatomy, tumours=ball_anatomy.tumours[:1])
    found = SMALL.sense(
        state_of(dataclasses.replace(ball_anatomy, target=target), cone), np.random.default_rng(0)
    )
    assert np.array_equal(found.is_target, target.is_tumour(found.points_m))


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"n_planes": 0}, "planes"),
        ({"n_planes": 9, "n_points": 8}, "sweep_points"),
        ({"half_sweep_rad": 2.0}, "sweep_half_angle_deg"),
        ({"seen_db": 0.0}, "seen_db"),
        ({"shadow_db": -1.0}, "shadow_db"),
        ({"tissue_spacing_m": 0.0}, "tissue_spacing_mm"),
        ({"n_planes": 10**9, "n_points": 10**9}, "image_pixels"),
    ],
)
def test_values_out_of_range_are_refused_by_field(changes, field):
    with pytest.raises(FieldError, match=field):
        dataclasses.replace(SMALL, **changes)


@pytest.mark.parametrize("name", ["organ", "tumour", "target", "surroundings"])
def test_an_unknown_tissue_is_refused_with_those_that_there_are(name):
    with pytest.raises(FieldError, match=rf"{name}_tissue=livr: choose a tissue: .*liver.*[Dd]id you mean"):
        TissueChoice(**{name: "livr"})


def test_a_grid_of_tissues_beyond_memory_is_refused(ball_anatomy, cone):
    sensor = dataclasses.replace(SMALL, tissue_spacing_m=1e-6)
    with pytest.raises(FieldError, match="tissue_spacing_mm"):
        sensor.sense(state_of(ball_anatomy, cone), np.random.default_rng(0))

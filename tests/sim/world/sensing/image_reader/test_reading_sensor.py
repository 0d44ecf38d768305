"""Readings of pictures: planted lesions are found, free tissue stays free, and doubt is told as likelihoods."""

import dataclasses

import numpy as np
import pytest
import trimesh

from planner import Workspace
from sim.episode.positioner import FreePositioner
from sim.world.scene.scene import build_scene
from sim.world.sensing.image_reader.frames import N_COLUMNS, FrameGrid, frames_of, plane_angle_rad
from sim.world.sensing.image_reader.image_reader import ImageReader
from sim.world.sensing.image_reader.reading_sensor import MOST_LOG_ODDS, ReadingSensor
from sim.world.sensing.sensor import SceneState
from sim.world.sensing.sweep import Sweep
from sim.world.sensing.ultrasound.convex_array import ConvexArray
from sim.world.sensing.ultrasound.ultrasound_sensor import TissueChoice, UltrasoundSensor
from sim.world.solids.solid import Solid

POSES = Workspace(np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]]))
SENSOR = ReadingSensor(ultrasound=UltrasoundSensor(n_planes=7))


def state_of(anatomy, cone) -> SceneState:
    scene = build_scene(anatomy, cone, arm=None)
    data = scene.new_data()
    FreePositioner(scene, POSES).place(data, 0, is_lifted=False)
    return SceneState(scene, data)


def with_lesion(anatomy, radius_m: float = 0.011):
    """The organ, a ball of 60 mm radius, with one lesion in its middle."""
    mesh = trimesh.creation.icosphere(radius=radius_m)
    mesh.apply_translation((0.5, 0.004, 0.065))
    return dataclasses.replace(anatomy, tumours=(Solid.from_trimesh(mesh),))


@pytest.fixture(scope="module")
def state(ball_anatomy, cone) -> SceneState:
    return state_of(with_lesion(ball_anatomy), cone)


@pytest.fixture(scope="module")
def reading(state):
    return SENSOR.sense(state, np.random.default_rng(0))


def overlap(called, truth) -> float:
    return 2.0 * (called & truth).sum() / (called.sum() + truth.sum())


@pytest.mark.parametrize("tissue", ["hypoechoic", "hyperechoic"])
def test_a_large_lesion_is_found_and_outlined(state, reading, tissue):
    sensor = dataclasses.replace(
        SENSOR, ultrasound=dataclasses.replace(SENSOR.ultrasound, tissues=TissueChoice(tumour=tissue))
    )
    found = reading if tissue == "hypoechoic" else sensor.sense(state, np.random.default_rng(0))
    truth = state.labels(found.points_m).is_tumour
    assert truth.sum() > 15
    # An outline that strays by 1 mm all round makes a Dice of 0.87 of a ball of 11 mm radius.
    assert overlap(found.is_occupied, truth) > 0.8
    assert found.is_occupied[~truth].mean() < 0.02


def test_tissue_without_a_lesion_is_called_free(ball_anatomy, cone):
    empty = state_of(dataclasses.replace(ball_anatomy, tumours=()), cone)
    found = SENSOR.sense(empty, np.random.default_rng(1))
    assert len(found.points_m) > 300
    assert found.is_occupied.mean() < 0.005


def test_doubt_is_told_as_likelihoods_that_agree_with_the_labels(reading):
    assert reading.log_odds is not None
    assert reading.weight is not None
    assert np.abs(reading.log_odds).max() <= MOST_LOG_ODDS
    # The prior odds of lesion are far below 1, so that a label of tumour speaks for it all the more.
    assert reading.log_odds[reading.is_occupied].min() > 0.0
    assert reading.log_odds[reading.is_occupied].mean() > 3.0
    assert reading.log_odds[~reading.is_occupied].max() <= 0.0
    assert reading.log_odds[~reading.is_occupied].mean() < -2.0
    assert (reading.weight > 0.0).all()
    assert (reading.weight <= 1.0).all()


def test_a_reader_that_tells_no_doubt_gives_the_same_labels_alone(state, reading):
    plain = dataclasses.replace(SENSOR, tells_doubt=False).sense(state, np.random.default_rng(0))
    assert np.array_equal(plain.is_occupied, reading.is_occupied)
    assert plain.log_odds is None
    assert plain.weight is None


def test_the_same_seed_gives_the_same_reading(state, reading):
    again = SENSOR.sense(state, np.random.default_rng(0))
    for name in ("points_m", "is_occupied", "log_odds", "weight"):
        assert getattr(again, name).tobytes() == getattr(reading, name).tobytes()
    assert again.images.middle_lesions.tobytes() == reading.images.middle_lesions.tobytes()


def test_labels_come_from_the_pictures_and_not_from_the_truth(state, reading):
    """Pictures in which all is mirrored left to right have the lesion on the other side."""
    sweep = reading.images
    array = SENSOR.ultrasound.array_of(state.cone)
    seen = SENSOR.reader.read(sweep, array)
    mirrored = dataclasses.replace(sweep, images=np.ascontiguousarray(sweep.images[:, :, ::-1]))
    again = SENSOR.reader.read(mirrored, array).log_odds[:, :, ::-1]
    assert overlap(again > 0.0, seen.log_odds > 0.0) > 0.8


def test_the_outline_in_the_picture_is_where_the_lesion_is(state, reading):
    sweep, middle = reading.images, reading.images.middle
    n_pixels = sweep.images.shape[1]
    assert sweep.middle_lesions.shape == (n_pixels, n_pixels)
    z_m = sweep.top_m + (np.arange(n_pixels) + 0.5) * sweep.pixel_m
    x_m = sweep.left_m + (np.arange(n_pixels) + 0.5) * sweep.pixel_m
    in_plane_m = np.stack(np.meshgrid(x_m, 0.0, z_m), axis=-1)[0].transpose(1, 0, 2)
    T = sweep.T_world_planes[middle]
    places_m = in_plane_m @ T[:3, :3].T + T[:3, 3]
    truth = state.labels(places_m.reshape(-1, 3)).is_tumour.reshape(n_pixels, n_pixels)
    assert overlap(sweep.middle_lesions, truth) > 0.8


def test_places_of_a_frame_are_found_again():
    grid = FrameGrid.of(ConvexArray(depth_m=0.1))
    rng = np.random.default_rng(0)
    rows, columns = rng.uniform(0, grid.n_rows - 1, 50), rng.uniform(0, N_COLUMNS - 1, 50)
    np.testing.assert_allclose(grid.places(grid.points_m(rows, columns)), np.stack([rows, columns], 1))
    assert grid.n_rows % 16 == 0
    assert grid.row_m == pytest.approx(0.001, rel=0.1)


def test_a_cell_has_the_brightness_of_the_picture_there():
    """A picture whose brightness grows with the depth, so that a cell's is known."""
    array, n_pixels, pixel_m = ConvexArray(), 512, 0.16 / 512
    ramp = np.repeat((np.arange(n_pixels) // 3)[:, None], n_pixels, axis=1).astype(np.uint8)
    sweep = Sweep(ramp[None], np.eye(4)[None], pixel_m, -0.08, -0.004, np.zeros(0, np.int64))
    grid = FrameGrid.of(array)
    brightness = grid.brightness(sweep)[0]
    rows, columns = np.meshgrid(np.arange(grid.n_rows), np.arange(N_COLUMNS), indexing="ij")
    depth_m = grid.points_m(rows.astype(float), columns.astype(float))[..., 1]
    # A step of the ramp is 3 pixels, of which one reading of a cell hits any.
    np.testing.assert_allclose(brightness, (depth_m + 0.004) / pixel_m / 3.0 - 0.5, atol=0.75)


def test_frames_hold_the_planes_beside_their_own():
    grid = FrameGrid.of(ConvexArray(depth_m=0.05))
    brightness = np.arange(4, dtype=np.float32)[:, None, None] * np.ones((1, grid.n_rows, N_COLUMNS), "f")
    frames = frames_of(grid, brightness * 64.0 + 96.0, 0.03)
    assert frames[:, :3, 0, 0].tolist() == [[0, 0, 1], [0, 1, 2], [1, 2, 3], [2, 3, 3]]


def test_the_angle_between_planes_is_that_of_the_sweep(reading, cone):
    assert plane_angle_rad(reading.images) == pytest.approx(2.0 * cone.half_angle_rad / 6)
    assert plane_angle_rad(dataclasses.replace(reading.images, T_world_planes=np.eye(4)[None])) == 0.0


def test_a_reader_needs_no_scene(reading, state):
    """The reader itself is handed pictures and what drew them, and nothing else."""
    answer = ImageReader().read(reading.images, SENSOR.ultrasound.array_of(state.cone))
    assert answer.log_odds.shape == (7, answer.grid.n_rows, N_COLUMNS)

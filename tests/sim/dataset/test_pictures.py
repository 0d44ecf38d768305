"""A picture's mask is the true tumour where the picture lies."""

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from PIL import Image

from sim.dataset.hdf5_shard import Hdf5Shard
from sim.dataset.pictures import mask_of_picture, place_of_picture
from sim.dataset.record import _picture, record_of
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import build_setup
from sim.pictures.png import png_bytes
from sim.running.fields import config_of
from sim.running.parts import make_parts
from sim.running.run_episode import make_episode
from sim.world.anatomy.anatomy import build_anatomy
from sim.world.sensing.sweep import Sweep
from sim.world.solids.solid import Solid

CENTRE_M, RADIUS_M = np.array([0.5, 0.01, 0.05]), 0.012


def ball(radius_m, centre_m):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius_m)
    return Solid(mesh.vertices + centre_m, mesh.faces)


@pytest.fixture(scope="module")
def anatomy():
    """A ball of 50 mm with a tumour of 12 mm aside of its middle."""
    organ, tumour = ball(0.05, np.array([0.5, 0.0, 0.05])), ball(RADIUS_M, CENTRE_M)
    return build_anatomy(organ, (tumour,), name="ball", rng=np.random.default_rng(0))


def sweep_of(T_world_plane, pixel_m=5e-4, shape=(160, 120)):
    """A sweep of three planes whose middle one lies at a place."""
    others = np.eye(4)
    return Sweep(
        np.zeros((3, *shape), np.uint8), np.stack([others, T_world_plane, others]), pixel_m, -0.03, -0.002,
        np.zeros(0, np.int64),
    )  # fmt: skip


def test_a_pixel_is_where_the_sweep_itself_puts_it() -> None:
    turn = trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    sweep = sweep_of(turn)
    place = place_of_picture(sweep) @ [17.0, 42.0, 0.0, 1.0]
    np.testing.assert_allclose(sweep.pixels(place[None, :3], 1)[0], [42.0, 17.0], atol=1e-9)


@pytest.mark.parametrize("aside_m", [0.0, 0.006, 0.0115, 0.013])
def test_a_ball_is_cut_in_the_circle_that_geometry_says(anatomy, aside_m) -> None:
    T = np.eye(4)
    # The plane hangs from above: its x is the world's x, its z is down, and it passes the middle at some distance.
    T[:3, :3] = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    T[:3, 3] = CENTRE_M + np.array([0.0, aside_m, 0.04])
    sweep = sweep_of(T)
    mask = mask_of_picture(sweep, anatomy)
    area_mm2 = (mask == 255).sum() * 0.25
    wanted_mm2 = np.pi * max(RADIUS_M**2 - aside_m**2, 0.0) * 1e6
    # Pixels of half a millimetre count an area to a share of its rim; the ball of triangles is a little smaller.
    assert area_mm2 == pytest.approx(wanted_mm2, abs=0.02 * wanted_mm2 + 3.0)
    if aside_m < 0.01:
        rows, columns = np.nonzero(mask)
        middle = place_of_picture(sweep) @ [columns.mean(), rows.mean(), 0.0, 1.0]
        np.testing.assert_allclose(middle[:3], CENTRE_M + np.array([0.0, aside_m, 0.0]), atol=2e-4)


def test_tissue_outside_the_organ_is_no_tumour(anatomy) -> None:
    T = np.eye(4)
    T[:3, 3] = [5.0, 5.0, 5.0]
    assert not mask_of_picture(sweep_of(T), anatomy).any()


def test_a_dataset_keeps_mask_and_place_beside_the_picture(tmp_path) -> None:
    pytest.importorskip("numba")
    h5py = pytest.importorskip("h5py")
    parts = make_parts(config_of(arm="none", motion="none", sensor="ultrasound", steps=2))
    parts = replace(parts, scenario=replace(SCENARIOS["liver"], n_poses=300, score_spacing_m=0.012))
    episode = make_episode(parts, build_setup(parts.scenario, None, parts.map_settings))
    record = record_of(episode, parts, png_bytes)
    row = record.steps[0]
    picture, mask = (np.array(Image.open(io.BytesIO(row[name]))) for name in ("image", "image_mask"))
    assert picture.shape == mask.shape
    assert set(np.unique(mask)) <= {0, 255}
    T = row["T_world_image"].reshape(4, 4)
    # Labels of the reading's own points on that plane, as the sensor saw the truth, are those of their pixels.
    points_m, is_tumour = row["points_m"].reshape(-1, 3), row["is_tumour"]
    column, line, off = (np.linalg.inv(T) @ np.column_stack([points_m, np.ones(len(points_m))]).T)[:3]
    on_plane = np.abs(off * np.linalg.norm(T[:3, 0])) < 1e-6
    assert on_plane.any()
    pixels = mask[np.rint(line[on_plane]).astype(int), np.rint(column[on_plane]).astype(int)] == 255
    # A point at a rim may lie on the other side of it than its pixel's middle.
    assert (pixels == is_tumour[on_plane]).mean() > 0.95
    shard = Hdf5Shard(tmp_path, 0)
    shard.add(0, record)
    shard.close()
    with h5py.File(tmp_path / "shard-00000.h5") as content:
        steps = content["episode_000000/steps"]
        n = steps["image_mask_length"][0]
        np.testing.assert_array_equal(
            np.array(Image.open(io.BytesIO(steps["image_mask"][:n].tobytes()))), mask
        )
        np.testing.assert_array_equal(steps["T_world_image"][:16], row["T_world_image"])
    moved = SimpleNamespace(body=object(), truth=episode.truth)
    assert _picture(moved, sweep_of(np.eye(4)), png_bytes)["image_mask"] is None

"""The options of a reader: what they become, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import sounding
from planner import Cone
from sim.errors import FieldError
from sim.running.fields import config_of
from sim.running.parts import make_parts
from sim.running.reader import told_rates
from sim.world.sensing.errors.erring_sensor import ErringSensor
from sim.world.sensing.errors.published import PUBLISHED
from sim.world.sensing.errors.reader_errors import ReaderErrors

IMAGE = {"sensor": "ultrasound", "reader": "image", "scenario": "sphere", "arm": "none"}
ERRING = {"sensor": "cone-with-errors", "scenario": "sphere", "arm": "none"}


def test_options_become_errors_in_si_units() -> None:
    parts = make_parts(
        config_of(
            ERRING,
            boundary_mm=2.0,
            missed_per_cm=0.1,
            false_blob_mm=4.0,
            penetration_mm=70.0,
        )
    )
    assert isinstance(parts.sensor, ErringSensor)
    errors = parts.sensor.errors
    assert errors.boundary_m == pytest.approx(0.002)
    assert errors.missed_per_m == pytest.approx(10.0)
    assert errors.false_blob_radius_m == pytest.approx(0.004)
    assert errors.penetration_m == pytest.approx(0.07)


def test_an_option_takes_the_place_of_the_readers_own() -> None:
    sensor = make_parts(config_of(ERRING, reader="published", missed_share=0.5)).sensor
    assert isinstance(sensor, ErringSensor)
    assert sensor.errors.missed_share == 0.5
    assert sensor.errors.boundary_share == PUBLISHED.boundary_share


def test_trust_is_exact_unless_the_sensor_errs() -> None:
    assert make_parts(config_of(scenario="sphere", arm="none")).trust is None
    assert make_parts(config_of(ERRING)).trust.learns
    told = make_parts(config_of(ERRING, label_trust="told", flipped_free=0.05)).trust
    assert not told.learns
    assert told.rates.false_positive == 0.05
    assert make_parts(config_of(ERRING, label_trust="exact")).trust is None


def test_a_false_blob_is_told_by_its_share_of_the_cone() -> None:
    """By drawing places in a cone and blobs about others."""
    rng, cone = np.random.default_rng(0), Cone(math.radians(20.0), 0.1)
    errors = ReaderErrors(false_blobs=1.0, false_blob_radius_m=0.005)
    depth_m = 0.1 * rng.random(4000) ** (1 / 3)
    radius_m = np.tan(cone.half_angle_rad) * depth_m * np.sqrt(rng.random(4000))
    angle = rng.uniform(0, 2 * np.pi, 4000)
    places_m = np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle), depth_m])
    blobs_m = errors.false_blob_radius_m * np.exp(0.3 * rng.standard_normal(1000))
    share = np.mean(
        [(np.linalg.norm(places_m - places_m[k], axis=1) < blob_m).mean() for k, blob_m in enumerate(blobs_m)]
    )
    # A part of a blob at the cone's face lies outside.
    assert share < told_rates(errors, cone).invented < 1.5 * share


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (
            {"reader": "published"},
            "the sensors cone-with-errors and ultrasound; cone has no such options",
        ),
        ({"boundary_mm": 1.0}, "goes only with the sensors cone-with-errors"),
        ({**ERRING, "missed_share": 1.5}, "must be from 0 to 1"),
        ({**ERRING, "boundary_length_mm": 0.0}, "must be above 0"),
        (
            {**ERRING, "flipped_free": 0.6, "flipped_tumour": 0.5},
            "0.5: must add up to less than 1 with `flipped_free` of 0.6",
        ),
        (
            {**ERRING, "flipped_free": 1.0},
            "flipped_free=1.0: must be 0 or more and below 1, since at 1 every",
        ),
        ({**ERRING, "false_blobs": 1e6}, "false_blobs=1000000.0: must be at most 100, more than which hide"),
        ({**ERRING, "sensor_option": ("a=1",)}, "goes only with a sensor of your own"),
        ({"label_trust": "told"}, "only a reader that errs tells its rates"),
        (
            {"reader": "image"},
            "reader=image: reads pictures, and the sensor cone draws none. Choose the sensor ultrasound",
        ),
        ({**ERRING, "reader": "image"}, "the sensor cone-with-errors draws none"),
        ({**IMAGE, "missed_share": 0.1}, "does not go with the reader image, whose errors are its own"),
        ({**IMAGE, "shadowing": ("rib",)}, "does not go with the reader image"),
        ({"reader_weights": "own.safetensors"}, "goes only with the reader image"),
        ({**IMAGE, "reader_weights": "none.safetensors"}, "this file cannot be read"),
        ({"sensor": "cone-with-eror"}, "Did you mean cone-with-errors?"),
    ],
)
def test_what_cannot_be_is_refused(options, text) -> None:
    with pytest.raises(FieldError, match=text.replace("?", r"\?")):
        make_parts(config_of(options))


def test_a_run_with_a_reader_that_errs_is_the_same_again(tmp_path) -> None:
    summaries = [
        sounding.run_episode(
            **ERRING, reader="published", steps=3, out=tmp_path / name, report=False, show_progress=False
        )
        for name in ("one", "two")
    ]
    assert summaries[0]["auprc"] == summaries[1]["auprc"]
    maps = [(tmp_path / name / "map.npz").read_bytes() for name in ("one", "two")]
    assert maps[0] == maps[1]


def test_pictures_may_be_read_with_errors_too() -> None:
    pytest.importorskip("numba")
    pictures = {"sensor": "ultrasound", "scenario": "sphere", "arm": "none"}
    exact = make_parts(config_of(pictures))
    assert not isinstance(exact.sensor, ErringSensor)
    assert exact.trust is None
    erring = make_parts(config_of(pictures, reader="published"))
    assert isinstance(erring.sensor, ErringSensor)
    assert erring.sensor.exact == exact.sensor
    assert erring.trust.learns


def test_the_reader_of_images_is_trusted_as_far_as_it_proves_or_as_it_says() -> None:
    pytest.importorskip("numba")
    told, learnt, taken = (
        make_parts(config_of(IMAGE, label_trust=trust)) for trust in (None, "learnt", "exact")
    )
    assert (learnt.sensor.tells_doubt, told.sensor.tells_doubt, taken.sensor.tells_doubt) == (
        False,
        True,
        False,
    )
    assert learnt.trust.learns
    assert told.trust.learns
    assert taken.trust is None


def test_an_episode_with_the_reader_of_images_is_the_same_again(tmp_path) -> None:
    pytest.importorskip("numba")
    for name in ("one", "two"):
        summary = sounding.run_episode(
            **IMAGE, seed=1000, steps=2, out=tmp_path / name, report=False, show_progress=False
        )
        assert summary["n_sensings"] == 2
    maps = [(tmp_path / name / "map.npz").read_bytes() for name in ("one", "two")]
    assert maps[0] == maps[1]


def test_a_reading_with_pictures_keeps_the_plane_of_each_point_that_stays(tmp_path) -> None:
    pytest.importorskip("numba")
    parts = make_parts(
        config_of(
            sensor="ultrasound", scenario="sphere", arm="none", penetration_mm=60.0, planes=4, image_pixels=64
        )
    )
    episode = sounding.Episode(
        sounding.build_setup(sounding.load_scenario("sphere")), parts.planner, seed=0, sensor=parts.sensor
    )
    reading = next(episode.steps(1)).reading
    depth_m = (reading.points_m - reading.T_world_probe[:3, 3]) @ reading.T_world_probe[:3, 2]
    assert depth_m.max() <= 0.06
    assert reading.images is not None
    assert reading.images.planes.shape == reading.is_occupied.shape

"""Options of a body that is not where the plan says: what they become, what a run tells of it, what cannot be."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest

import sounding
from sim.errors import FieldError
from sim.findings.account import read_account
from sim.record.poses import read_poses
from sim.record.recording import read_recording
from sim.record.run_record import load_run
from sim.report.arm_parts import arm_parts, body_poses, body_ways
from sim.running.fields import changed, config_of
from sim.running.parts import check_config, make_parts
from sim.running.placing.body import motion_of
from sim.viewing.replay import replay_table
from sim.viewing.video import VideoSettings, _pictures
from sim.world.frames import quaternion_matrix
from sim.world.solids.surface_distance import surface_distance_of

FREE = {"scenario": "sphere", "arm": "none", "motion": "none", "planner": "random"}
SERVO = {"arm": "default", "motion": "servo"}
OFF = {"registration_mm": 8.0, "registration_deg": 3.0, "tracking_mm": 1.0}


def test_an_organ_that_lies_as_planned_has_no_body() -> None:
    parts = make_parts(config_of(FREE, register="none", contact_search_mm=20.0))
    assert parts.body is None


def test_options_become_settings_in_si_units() -> None:
    body = make_parts(config_of(FREE, **OFF, breathing_mm=10.0, gating=True, contact_search_mm=20.0)).body
    assert body.settings.registration_m == pytest.approx(0.008)
    assert body.settings.registration_rad == pytest.approx(math.radians(3.0))
    assert body.settings.tracking_m == pytest.approx(0.001)
    assert body.settings.breathing_m == pytest.approx(0.010)
    assert body.settings.contact_search_m == pytest.approx(0.020)
    assert body.settings.is_gated
    assert body.tissue is None
    elastic = make_parts(config_of(FREE, tissue="elastic", young_kpa=4.0)).body
    assert elastic.tissue.youngs_modulus_pa == pytest.approx(4000.0)


def test_the_map_is_as_sure_of_rims_as_the_body_lets_it() -> None:
    def sharpness(**options):
        return make_parts(config_of(FREE | {"map_settings": "calibrated"}, **options)).detail.sharpness

    plain = sharpness()
    assert sharpness(registration_mm=8.0) == plain
    assert sharpness(tissue="elastic", register="none") == plain
    loads = [sharpness(tissue="elastic", press_n=force_n) for force_n in (0.5, 1.0, 3.0)]
    assert plain > loads[0] > loads[1] > loads[2]
    # Labels of a reader that errs count for one within a view, so that less doubt is left.
    errs, off = (
        {"sensor": "cone-with-errors", "reader": "published"},
        {"tracking_mm": 1.0, "tissue": "elastic"},
    )
    assert sharpness(**errs) > sharpness(**errs, **off) > sharpness(**errs) * sharpness(**off) / plain
    assert plain > sharpness(tracking_mm=1.0) > sharpness(tracking_mm=1.0, tissue="elastic", press_n=1.0)


def test_a_force_is_pressed_with_where_servos_are_told_one() -> None:
    def forces_n(**options):
        parts = make_parts(config_of(FREE | options))
        return parts.servo_settings.press_n, None if parts.body is None else parts.body.press_n

    assert forces_n(**SERVO) == (None, None)
    assert forces_n(**SERVO, press_n=0.5) == (0.5, None)
    assert forces_n(**SERVO, registration_mm=5.0) == (None, 1.0)
    assert forces_n(**SERVO, tissue="elastic") == (None, 1.0)
    assert forces_n(**SERVO, tissue="elastic", press_n=4.0) == (None, 4.0)
    assert forces_n(tissue="elastic", press_n=0.5) == (None, 0.5)


def test_an_arm_holds_a_force_on_a_rigid_organ_by_servos() -> None:
    pressing = config_of(scenario="sphere", press_n=0.5)

    def moved(config) -> str:
        return motion_of(config.moving.motion, config.arm, config.body)

    assert moved(pressing) == "servo"
    assert make_parts(pressing).motion == "servo"
    # What was asked for stays, so that options can be changed in any order.
    assert pressing.moving.motion == "kinematic"
    for other in ({"press_n": None}, {"tissue": "elastic"}, {"motion": "servo", "press_n": None}):
        assert moved(changed(pressing, **other)) == other.get("motion", "kinematic")
    for free in ({"motion": "none"}, {"arm": "none"}):
        with pytest.raises(FieldError, match=r"press_n=0.5.*means nothing without .*`motion` servo"):
            check_config(changed(pressing, **free))


def test_labels_that_lie_off_get_a_map_that_knows_it() -> None:
    exact, off, naive = (
        make_parts(config_of(FREE | {"planner": "find-and-outline"} | options)).detail
        for options in ({}, {"tracking_mm": 3.0}, {"tracking_mm": 3.0, "register": "none"})
    )
    assert off.variance < 0.05 * exact.variance
    assert naive == exact


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"registration_mm": 200.0}, "registration_mm=.*from 0 to 100"),
        ({"breathing_axis": (0.0, 0.0, 0.0), "breathing_mm": 5.0}, "breathing_axis=.*zero length"),
        ({"breathing_s": 0.0, "breathing_mm": 5.0}, "breathing_s=.*from 0.5 to 60"),
        ({"press_n": 0.0}, "press_n=.*from 0.01 to 50"),
        ({"press_n": 2.0}, "press_n=2.0.*means nothing without `tissue` elastic or `motion` servo"),
        ({"align_readings": False}, "align_readings=False.*means nothing without an error of the tip"),
        (
            {"align_readings": False, "tracking_mm": 1.0, "register": "none"},
            "align_readings=False.*means nothing without .*`register` contacts",
        ),
        ({"gating": True}, "gating=True.*means nothing without `breathing_mm` above 0"),
        ({"young_kpa": 0.0}, "young_kpa=.*from 0.1"),
        (SERVO | {"tissue": "elastic", "press_n": 8.0}, "press_n=8.0.*below the 5 N of `force_limit_n`"),
        (SERVO | {"press_n": 8.0}, "press_n=8.0.*below the 5 N of `force_limit_n`"),
        (SERVO | {"press_n": 1.0, "press_mm": 4.0}, "press_mm=4.0.*stops at a force"),
        (
            SERVO | {"tissue": "elastic", "stiffness_n_m": 100.0},
            "stiffness_n_m=100.0.*follows from `young_kpa`",
        ),
    ],
)
def test_what_cannot_be_is_told_before_anything_is_built(wrong, text) -> None:
    with pytest.raises(FieldError, match=text):
        check_config(config_of(FREE | wrong))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("body") / "run"
    summary = sounding.run_episode(**FREE, **OFF, steps=6, out=str(folder), show_progress=False)
    return folder, summary


def test_a_run_tells_how_well_it_knows_where_the_organ_lies(run) -> None:
    folder, summary = run
    with (folder / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[-1]["registration_error_m"]) == summary["registration_error_m"]
    assert 0.0 < summary["registration_error_m"] < 0.03
    assert summary["registration_deviation_m"] > 0.0
    assert "auprc_own_frame" in summary
    assert "By the contacts the tumours are believed" in read_account(folder, summary).ended


def test_the_belief_is_kept_with_the_way_to_the_patients_files(run) -> None:
    folder, _ = run
    body = json.loads((folder / "body.json").read_text())
    config = json.loads((folder / "config.json").read_text())
    T_world_rest = np.array(body["T_world_rest"])
    planned = np.array(config["T_input_world"])
    np.testing.assert_allclose(
        np.array(body["T_input_world"]), planned @ np.linalg.inv(T_world_rest), atol=1e-12
    )
    assert np.array(body["covariance"]).shape == (9, 9)
    assert np.linalg.norm(np.array(body["T_world_rest_true"])[:3, 3]) > 0.0


def test_a_folder_tells_where_the_organ_truly_was_at_every_state(run) -> None:
    """Whoever draws the run has organ, tip and tumours where they were: the tip on the surface of the organ."""
    folder, summary = run
    record, recording = load_run(folder), read_recording(folder)
    surface = surface_distance_of(record.anatomy.organ)
    body = json.loads((folder / "body.json").read_text())
    for row, step in enumerate(recording.motions):
        np.testing.assert_allclose(recording.T_world_rest_sensed(step), body["T_world_rest_true"], atol=1e-12)
        tip_m = recording.tips_rest_m(step)[-1]
        # Some point of the face touches; its middle is off the organ by as much as that is curved under it.
        assert -1e-5 < surface.signed_distance_m(tip_m[None])[0] < 1e-3
        np.testing.assert_allclose(record.T_world_probe[row, :3, 3], tip_m, atol=1e-9)
    # Who knows where the probe truly was finds the share that was sensed, which the belief of the moment does not.
    assert record.is_seen().any(axis=0).mean() == pytest.approx(summary["sensed_fraction"], abs=1e-9)
    believed = read_poses(folder)[1]
    assert np.linalg.norm(believed[0, :3, 3] - record.T_world_probe[0, :3, 3]) > 0.001


def test_a_report_draws_the_probe_where_it_truly_stood_in_the_organ(run) -> None:
    folder, _ = run
    recording = read_recording(folder)
    surface = surface_distance_of(recording.scene.anatomy.organ)
    names = list(dict.fromkeys(name for name, *_ in arm_parts(recording)))
    poses, ways = body_poses(recording, names), body_ways(recording, names, 3)
    tip_m = recording.scene.model.site(recording.scene.tip_site).pos
    for pose, way in zip(poses[1:], ways, strict=True):
        np.testing.assert_allclose(pose, way[-1], atol=1e-6)
        place_m = pose[0, :3] + quaternion_matrix(pose[0, 3:]) @ tip_m
        assert -1e-5 < surface.signed_distance_m(place_m[None])[0] < 1e-3


def test_a_run_of_an_organ_that_lies_as_planned_keeps_no_places(tmp_path) -> None:
    sounding.run_episode(**FREE, steps=2, out=str(tmp_path / "run"), show_progress=False)
    recording = read_recording(tmp_path / "run")
    assert not recording.places
    np.testing.assert_array_equal(recording.T_world_rest_at(1.0), np.eye(4))
    with np.load(tmp_path / "run" / "motion" / "00001.npz") as arrays:
        assert sorted(arrays.files) == ["phases", "states", "time_s", "tips_m"]


def test_a_replay_measures_from_where_the_poses_truly_lay(run) -> None:
    folder, _ = run
    recording, T = (
        read_recording(folder),
        np.array(json.loads((folder / "body.json").read_text())["T_world_rest_true"]),
    )
    told_mm = [float(line.split()[4]) for line in replay_table(recording).splitlines()[1:-1]]
    poses_m = recording.sensed_m @ T[:3, :3].T + T[:3, 3]
    tips_m = np.array([motion.tips_m[-1] for motion in recording.motions.values()])
    np.testing.assert_allclose(told_mm, 1e3 * np.linalg.norm(tips_m - poses_m, axis=1), atol=0.001)


def test_a_video_draws_the_organ_where_it_truly_was(run) -> None:
    """The same states with the organ as planned give another picture, and the same picture twice."""
    recording = read_recording(run[0])
    settings, n = VideoSettings(width_px=320, height_px=240), 1
    true, planned = (
        next(_pictures(each, settings, n)).astype(int) for each in (recording, replace(recording, places={}))
    )
    assert (np.abs(true - planned).max(axis=2) > 40).mean() > 0.002
    still = next(_pictures(replace(recording, places={}), settings, n))
    np.testing.assert_array_equal(still, planned)


def test_a_run_from_its_config_has_the_same_body(run, tmp_path) -> None:
    folder, summary = run
    again = sounding.run_episode(
        config=folder / "config.json", out=str(tmp_path / "again"), show_progress=False
    )
    assert again["registration_error_m"] == summary["registration_error_m"]
    assert again["auprc"] == summary["auprc"]


def test_pictures_show_the_organ_where_it_is_and_leave_the_state_as_it_was(sphere_setup) -> None:
    from sim.pictures.moved_anatomy import moved_anatomy

    data = sphere_setup.scene.new_data()
    organ = data.model.geom("organ").id
    before_m, probe_m = data.geom_xpos[organ].copy(), data.site_xpos.copy()
    T = np.eye(4)
    T[:3, 3] = (0.01, 0.02, 0.03)
    with moved_anatomy(data, T):
        np.testing.assert_allclose(data.geom_xpos[organ] - before_m, T[:3, 3], atol=1e-12)
    np.testing.assert_array_equal(data.geom_xpos[organ], before_m)
    np.testing.assert_array_equal(data.site_xpos, probe_m)


def test_actions_may_be_spent_on_registering_where_there_is_something_to_learn() -> None:
    assert make_parts(config_of(FREE, **OFF)).body.register_above_m == math.inf
    assert make_parts(config_of(FREE, **OFF, register_above_mm=3.0)).body.register_above_m == 0.003
    for options in ({}, OFF | {"register": "none"}, OFF | {"register_above_mm": 0.0}):
        with pytest.raises(FieldError, match="register_above_mm"):
            make_parts(config_of(FREE, **({"register_above_mm": 3.0} | options)))

"""Servos that press with a force: on an organ that lies elsewhere, breathes or yields, and where there is none."""

from itertools import pairwise

import numpy as np
import pytest

from planner import make_planner
from sim.episode.body_options import BodyOptions
from sim.episode.episode import Episode
from sim.episode.moving.arm_motion import make_motion_model
from sim.episode.moving.motion import Phase, ProcedureStoppedError
from sim.errors import FieldError
from sim.world.body.settings import BodySettings
from sim.world.frames import rigid_inverse
from sim.world.motion.settings import LIVER_YOUNG_PA, ServoSettings, punch_stiffness_n_m
from sim.world.solids.surface_distance import surface_distance_of
from sim.world.tissue.settings import ElasticSettings

OFF = {"registration_m": 0.008, "registration_rad": np.deg2rad(3.0)}
K_N_M = punch_stiffness_n_m(LIVER_YOUNG_PA)
POSES = (7_000, 13_000)


def episode(
    setup, *, seed=1, registration="contacts", tissue=None, press_n=1.0, servo=None, **settings
) -> Episode:
    body = BodyOptions(
        settings=BodySettings(**settings), registration=registration, tissue=tissue, press_n=press_n
    )
    motion_model = make_motion_model(setup, "servo", servo=servo)
    return Episode(
        setup, make_planner("random"), seed=seed, body=body, motion_model=motion_model, tumour_map=None
    )


def tip_at_rest(run) -> tuple[np.ndarray, np.ndarray]:
    """Tip and beam in the frame of the organ at rest."""
    site = run.data.site(run.setup.scene.tip_site)
    T_rest_world = rigid_inverse(run.body.place.T_world_rest(run.body.sensed_s))
    return T_rest_world[:3, :3] @ site.xpos + T_rest_world[:3, 3], T_rest_world[:3, :3] @ site.xmat.reshape(
        3, 3
    )[:, 2]


def test_the_probe_stops_at_its_force_on_the_true_surface(sphere_arm_setup) -> None:
    servo = ServoSettings(press_n=0.4)
    run, surface = episode(sphere_arm_setup, servo=servo, **OFF), surface_distance_of(sphere_arm_setup.organ)
    for step in run.steps(3):
        motion = step.motion
        assert motion.contact_force_n == pytest.approx(0.4, rel=0.01)
        assert motion.force_error_n == pytest.approx(motion.contact_force_n - 0.4)
        # It comes near its force without going beyond, but for the damper and one acceleration.
        assert motion.peak_force_n < 1.1 * 0.4
        tip_m, beam = tip_at_rest(run)
        touched_m = tip_m - motion.contact_force_n / K_N_M * beam
        assert abs(surface.signed_distance_m(touched_m[None])[0]) < 1e-4
        held = motion.states[motion.phases == Phase.HOLD]
        assert np.abs(held[-1] - held[-5]).max() < 1e-4
        assert (np.diff(motion.time_s) > 0.0).all()


def test_without_a_force_it_is_that_of_the_spring_at_the_depth(sphere_arm_setup) -> None:
    (step,) = episode(sphere_arm_setup, servo=ServoSettings(press_m=0.003), **OFF).steps(1)
    assert step.motion.contact_force_n == pytest.approx(0.003 * K_N_M, rel=0.01)


def test_what_it_learns_of_the_place_is_where_it_first_touched(sphere_arm_setup) -> None:
    run = episode(sphere_arm_setup, servo=ServoSettings(press_n=0.4), **OFF)
    errors_m = [step.body.registration_error_m for step in run.steps(5)]
    assert errors_m[-1] < errors_m[0]
    # The contacts are exact but for the dent of 4.6 mm, which is taken off.
    T_true, contacts = run.body.T_world_rest, run.body.belief.contacts
    rest_m = (np.array([each.position_m for each in contacts]) - T_true[:3, 3]) @ T_true[:3, :3]
    assert np.abs(surface_distance_of(sphere_arm_setup.organ).signed_distance_m(rest_m)).max() < 1e-4


def test_the_force_is_that_of_the_tissue_at_the_depth(sphere_arm_setup) -> None:
    tissue = ElasticSettings(youngs_modulus_pa=6000.0)
    run = episode(sphere_arm_setup, tissue=tissue, press_n=0.5, **OFF)
    for step in run.steps(3):
        assert step.motion.contact_force_n == pytest.approx(0.5, rel=0.02)
        tip_m, beam = tip_at_rest(run)
        indentation = run.body.indentation
        touched_m = indentation.contact.position_m
        depth_m = float((tip_m - touched_m) @ beam)
        law = run.body.yielding._true.press(touched_m, beam, depth_m=depth_m, face_radius_m=0.008)
        assert step.motion.contact_force_n == pytest.approx(law.force_n, rel=0.02)
        assert abs(surface_distance_of(sphere_arm_setup.organ).signed_distance_m(touched_m[None])[0]) < 1e-5


def test_a_probe_follows_an_organ_that_breathes_with_its_force(sphere_arm_setup) -> None:
    breathing = {"breathing_m": 0.01, "breathing_axis": (0.0, 0.0, 1.0)}
    run = episode(sphere_arm_setup, registration="none", servo=ServoSettings(press_n=0.4), **breathing)
    surface, shares = surface_distance_of(sphere_arm_setup.organ), []
    for step in run.steps(4):
        shares.append(run.body.inhaled_share)
        assert step.motion.contact_force_n == pytest.approx(0.4, rel=0.1)
        assert step.motion.peak_force_n < 0.6
        tip_m, beam = tip_at_rest(run)
        # The damper of 2 N s/m holds some hundredths of a newton against an organ that moves by 24 mm/s.
        touched_m = tip_m - step.motion.contact_force_n / K_N_M * beam
        assert abs(surface.signed_distance_m(touched_m[None])[0]) < 6e-4
    assert max(shares) > 0.1
    assert run.body.encounter.time_s == pytest.approx(run.body.encounter._began_s)


def test_a_gated_probe_senses_while_the_organ_rests(sphere_arm_setup) -> None:
    breathing = {"breathing_m": 0.01, "breathing_axis": (0.0, 0.0, 1.0)}
    run = episode(sphere_arm_setup, is_gated=True, **OFF, **breathing)
    for _ in run.steps(3):
        assert run.body.inhaled_share <= 0.02


def test_motions_that_press_follow_one_another(sphere_arm_setup) -> None:
    run = episode(sphere_arm_setup, registration="none", **OFF)
    motions = [step.motion for step in run.steps(3)]
    for before, after in pairwise(motions):
        # A state is recorded every 10 ms, in which no joint of this arm turns by more than 26 mrad.
        assert np.abs(after.states[0] - before.states[-1]).max() < 0.03
        assert after.phases[0] == Phase.LIFT
        assert (np.diff(after.phases.astype(int)) >= 0).all()


def test_where_there_is_no_organ_the_pose_is_skipped_and_the_arm_goes_on(sphere_arm_setup) -> None:
    run = episode(sphere_arm_setup, seed=0, registration="none", registration_m=0.05, contact_search_m=0.0)
    steps = list(run.steps(3))
    reasons = [skipped.reason for step in steps for skipped in step.skipped]
    missed = [reason for reason in reasons if "met no organ from 40 mm above to 0 mm below" in reason]
    assert missed
    assert steps[-1].motion.is_done


def test_an_organ_as_planned_is_pressed_with_a_force_too(sphere_arm_setup) -> None:
    motion_model = make_motion_model(sphere_arm_setup, "servo", servo=ServoSettings(press_n=1.2))
    data, workspace = sphere_arm_setup.scene.new_data(), sphere_arm_setup.workspace
    for pose in POSES:
        motion = motion_model.move(data, pose)
        assert motion.contact_force_n == pytest.approx(1.2, rel=0.01)
        way_m = motion.tips_m[-1] - workspace.positions_m[pose]
        np.testing.assert_allclose(way_m, 1.2 / K_N_M * workspace.normals[pose], atol=2e-4)


def test_too_much_force_stops_the_arm(sphere_arm_setup) -> None:
    servo = ServoSettings(stiffness_n_m=50_000.0, press_n=1.0, force_limit_n=1.2)
    motion_model = make_motion_model(sphere_arm_setup, "servo", servo=servo)
    with pytest.raises(ProcedureStoppedError, match="limit of 1.2 N.*`press_n`"):
        motion_model.move(sphere_arm_setup.scene.new_data(), POSES[0])


@pytest.mark.parametrize(
    ("servo", "text"),
    [
        ({"press_n": 5.0}, "press_n=5.0: must be above 0 and below the 5 N of `force_limit_n`"),
        ({"press_n": 0.0}, "press_n=0.0: must be above 0"),
    ],
)
def test_a_force_that_cannot_be_is_told(servo, text) -> None:
    with pytest.raises(FieldError, match=text):
        ServoSettings(**servo)


def test_a_spring_that_gives_way_too_far_is_told(sphere_arm_setup) -> None:
    with pytest.raises(
        FieldError, match=r"press_n=4.0: presses a spring of 87.5 N/m 46 mm in.*at most 3\.5 N"
    ):
        make_motion_model(sphere_arm_setup, "servo", servo=ServoSettings(press_n=4.0))
    with pytest.raises(FieldError, match=r"press_mm=0.0: makes 0 N.*`press_n`"):
        episode(sphere_arm_setup, servo=ServoSettings(press_m=0.0), **OFF)

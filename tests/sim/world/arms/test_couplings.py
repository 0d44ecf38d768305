"""Arms whose joints depend on each other are refused with what couples them; what lies beside the chain is not."""

from __future__ import annotations

import numpy as np
import pytest

from sim.world.ik.search import IkSearch
from sim.world.scene.arm import ArmError, ArmModel
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import build_scene

TOP_M, DOWN = np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]])
ARM = """<mujoco><compiler angle="radian"/>
<option>{flags}</option>
<default><geom type="capsule" size="0.03" mass="1"/><joint axis="0 1 0" range="-2.6 2.6" limited="true"/></default>
<worldbody><body name="post"><geom fromto="0 0 0.05 0 0 0.3"/><site name="foot"/>
 <body name="upper" pos="0 0 0.42"><joint name="turn" axis="0 0 1"/><joint name="lift"/>
  <geom fromto="0.02 0 0 0.38 0 0"/><site name="on_upper" pos="0.1 0 0.05"/>
  <body name="fore" pos="0.45 0 0"><joint name="bend"/><geom fromto="0.02 0 0 0.33 0 0"/>
   <site name="on_fore" pos="0.1 0 0.05"/>
   <body name="hand" pos="0.4 0 0"><joint name="roll" axis="1 0 0"/><joint name="nod"/>
    <geom type="sphere" size="0.025"/><site name="flange" quat="0.7071068 0 0.7071068 0"/>
    <body name="left" pos="-0.02 0.05 0"><joint name="left" type="slide" axis="0 1 0" range="0 0.02"/>
     <geom type="sphere" size="0.008" mass="0.1"/><site name="on_left"/></body>
    <body name="right" pos="-0.02 -0.05 0"><joint name="right" type="slide" axis="0 -1 0" range="0 0.02"/>
     <geom type="sphere" size="0.008" mass="0.1"/><site name="on_right"/></body>
   </body></body></body></body></worldbody>
{extra}</mujoco>"""
BOTH_WRISTS = """<tendon><fixed name="sum"><joint joint="roll" coef="1"/><joint joint="nod" coef="1"/></fixed>
<fixed name="difference"><joint joint="roll" coef="1"/><joint joint="nod" coef="-1"/></fixed></tendon>"""
FINGERS = """<tendon><fixed name="grip"><joint joint="left" coef="1"/><joint joint="right" coef="1"/></fixed>
<spatial name="cord" limited="true" range="0 1"><site site="on_left"/><site site="on_right"/></spatial></tendon>"""


def arm(tmp_path, extra="", flags="") -> ArmModel:
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(extra=extra, flags=flags))
    return ArmModel(path=path)


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (
            '<equality><joint name="belt" joint1="bend" joint2="lift" polycoef="0 -1.5 0 0 0"/></equality>',
            "the joint constraint 'belt' makes bend depend on lift",
        ),
        ('<equality><joint joint1="nod"/></equality>', "the unnamed joint constraint holds nod where it is"),
        (  # a finger that the chain drives would not stay at home
            '<equality><joint name="cam" joint1="left" joint2="nod"/></equality>',
            "the joint constraint 'cam' makes left depend on nod",
        ),
        (
            '<equality><connect name="rod" body1="post" body2="fore" anchor="0 0 0"/></equality>',
            "the connect constraint 'rod' ties post to fore",
        ),
        (
            '<equality><connect name="rod" site1="on_upper" site2="on_fore"/></equality>',
            "the connect constraint 'rod' ties upper to fore",
        ),
        ('<equality><weld name="brake" body1="hand"/></equality>', "'brake' ties hand to the world"),
        (
            '<equality><weld name="brake" site1="on_left" site2="foot"/></equality>',
            "the weld constraint 'brake' ties left to post",
        ),
        (
            BOTH_WRISTS + '<equality><tendon name="loop" tendon1="sum"/></equality>',
            "the tendon constraint 'loop' holds the length of sum",
        ),
        (
            BOTH_WRISTS.replace('name="sum"', 'name="sum" limited="true" range="-1 1"'),
            "the limits of sum allow some joint positions only together",
        ),
        (
            '<tendon><spatial name="wire" limited="true" range="0 1"><site site="foot"/>'
            '<site site="on_fore"/></spatial></tendon>',
            "the limits of wire",
        ),
        (
            BOTH_WRISTS + '<actuator><position name="one" tendon="sum"/></actuator>',
            "the actuator 'one' drives roll, nod together",
        ),
        ('<actuator><motor name="rope" site="flange" refsite="foot"/></actuator>', "actuator 'rope'"),
    ],
)
def test_coupled_joints_are_refused_with_the_name_of_what_couples_them(tmp_path, extra, words) -> None:
    with pytest.raises(ArmError, match="moves every joint between base and flange on its own") as caught:
        arm(tmp_path, extra).load()
    assert words in str(caught.value)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_many_couplings_are_counted(tmp_path) -> None:
    with pytest.raises(ArmError, match="; and 2 more"):
        arm(tmp_path, "<equality>" + 5 * '<joint joint1="bend" joint2="lift"/>' + "</equality>").load()


@pytest.mark.parametrize(
    ("extra", "flags"),
    [
        ('<equality><joint joint1="bend" joint2="lift" active="false"/></equality>', ""),
        ('<equality><joint joint1="right" joint2="left"/></equality>', ""),
        ('<equality><connect body1="left" body2="right" anchor="0 0 0"/></equality>', ""),
        ('<equality><weld body1="left" body2="hand"/></equality>', ""),
        ('<equality><weld body1="post"/></equality>', ""),
        (
            BOTH_WRISTS.replace('name="sum"', 'name="sum" limited="true" range="-1 1"'),
            '<flag limit="disable"/>',
        ),
        (FINGERS + '<equality><tendon tendon1="grip"/></equality><actuator><motor tendon="grip"/></actuator>', ""),
        (BOTH_WRISTS, ""),
        (BOTH_WRISTS + '<actuator><motor tendon="sum"/><motor tendon="difference"/></actuator>', ""),
        (
            BOTH_WRISTS + '<actuator><motor tendon="sum"/><motor joint="nod"/><motor joint="roll"/></actuator>',
            "",
        ),
        ('<equality><joint joint1="bend" joint2="lift"/></equality>', '<flag equality="disable"/>'),
        ('<equality><joint joint1="bend" joint2="lift"/></equality>', '<flag constraint="disable"/>'),
    ],
)  # fmt: skip
def test_what_couples_no_joint_of_the_chain_is_no_reason_to_refuse(tmp_path, extra, flags) -> None:
    arm(tmp_path, extra, flags).load()


def test_constraints_that_the_file_switches_off_stay_off_in_the_scene(tmp_path, ball_anatomy, cone) -> None:
    extra = '<equality><joint joint1="bend" joint2="lift"/></equality>'
    scene = build_scene(ball_anatomy, cone, arm=arm(tmp_path, extra, '<flag equality="disable"/>'))
    assert not scene.new_data().eq_active.any()


def test_the_answers_of_an_arm_with_coupled_fingers_are_those_of_one_without(
    tmp_path, ball_anatomy, cone, ball_distance
) -> None:
    answers = []
    for extra in ("", '<equality><joint joint1="right" joint2="left"/></equality>'):
        scene = build_scene(ball_anatomy, cone, arm=arm(tmp_path, extra))
        answers.append(IkSearch(scene, Clearance(scene, ball_distance)).search(TOP_M, DOWN))
    assert answers[0].is_reached.all()
    np.testing.assert_array_equal(answers[0].q, answers[1].q)

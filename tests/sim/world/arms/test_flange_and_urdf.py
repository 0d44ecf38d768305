"""The flange may be a body, and an arm a URDF; MuJoCo's errors are told whole."""

from __future__ import annotations

import numpy as np
import pytest

from sim.world.ik.search import IkSearch
from sim.world.scene.arm import ArmError, ArmModel
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import build_scene

TOP_M, DOWN = np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]])
MJCF = """<mujoco><compiler angle="degree" autolimits="true"/><default><geom type="capsule" size="0.03"/></default>
<worldbody><body name="post"><geom fromto="0 0 0.05 0 0 0.35"/><body name="upper" pos="0 0 0.42">
<joint axis="0 0 1" range="-170 170"/><joint axis="0 1 0" range="-120 120"/><geom fromto="0.02 0 0 0.38 0 0"/>
<body name="fore" pos="0.45 0 0"><joint axis="0 1 0" range="-150 150"/><geom fromto="0.02 0 0 0.33 0 0"/>
<body name="hand" pos="0.4 0 0"><joint axis="1 0 0" range="-170 170"/><joint axis="0 1 0" range="-120 120"/>
<geom type="sphere" size="0.025"/>{tool}</body></body></body></body></worldbody></mujoco>"""
FRAME = 'pos="0.01 0 0" quat="0.7071068 0 0.7071068 0"'
INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def urdf(
    *, tool="tool0", tool_rpy="0 1.5707963 0", head="", geometry='<sphere radius="0.025"/>', mimic=""
) -> str:
    """The same arm; its links are boxes, since URDF has no capsules."""

    def link(name: str, x_m: float, length_m: float) -> str:
        shape = f'<geometry><box size="{length_m} 0.05 0.05"/></geometry>'
        return f'<link name="{name}">{INERTIAL}<collision><origin xyz="{x_m} 0 0"/>{shape}</collision></link>'

    def joint(name: str, parent: str, child: str, xyz: str, axis: str, more: str = "") -> str:
        return (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
            f'<limit lower="-2.5" upper="2.5" effort="90" velocity="2"/>{more}</joint>'
        )

    return f"""<?xml version="1.0"?><robot name="six">{head}<link name="base_link"><collision><origin xyz="0 0 0.2"/>
    <geometry><cylinder radius="0.03" length="0.3"/></geometry></collision></link><link name="turret">{INERTIAL}</link>
    {link("upper", 0.2, 0.36)}{link("fore", 0.17, 0.3)}<link name="cuff">{INERTIAL}</link>
    <link name="hand">{INERTIAL}<collision><geometry>{geometry}</geometry></collision></link><link name="{tool}"/>
    {joint("turn", "base_link", "turret", "0 0 0.42", "0 0 1")}{joint("lift", "turret", "upper", "0 0 0", "0 1 0")}
    {joint("bend", "upper", "fore", "0.45 0 0", "0 1 0", mimic)}{joint("roll", "fore", "cuff", "0.4 0 0", "1 0 0")}
    {joint("nod", "cuff", "hand", "0 0 0", "0 1 0")}<joint name="end" type="fixed"><parent link="hand"/>
    <child link="{tool}"/><origin xyz="0.01 0 0" rpy="{tool_rpy}"/></joint></robot>"""


def built(tmp_path, text, anatomy, cone, *, name="arm.xml", flange=None):
    (tmp_path / name).write_text(text)
    return build_scene(anatomy, cone, arm=ArmModel(path=tmp_path / name, flange=flange))


def answers(scene, distance):
    return IkSearch(scene, Clearance(scene, distance)).search(TOP_M, DOWN)


def test_a_body_carries_the_probe_as_a_site_at_its_frame_does(
    tmp_path, ball_anatomy, cone, ball_distance
) -> None:
    by_site = built(
        tmp_path, MJCF.format(tool=f'<site name="end" {FRAME}/>'), ball_anatomy, cone, flange="end"
    )
    by_body = built(
        tmp_path, MJCF.format(tool=f'<body name="end" {FRAME}/>'), ball_anatomy, cone, flange="end"
    )
    expected, found = answers(by_site, ball_distance), answers(by_body, ball_distance)
    assert expected.is_reached.all()
    np.testing.assert_allclose(found.q, expected.q, atol=1e-12)


def test_of_a_site_and_a_body_of_one_name_the_site_is_meant(tmp_path, ball_anatomy, cone) -> None:
    tool = f'<site name="end" {FRAME}/><body name="end" pos="0 0 0.3"/>'
    scene = built(tmp_path, MJCF.format(tool=tool), ball_anatomy, cone, flange="end")
    data = scene.new_data()
    np.testing.assert_allclose(data.body("probe_probe").xpos, [0.86, 0.0, 0.42], atol=1e-6)


@pytest.mark.parametrize("name", ["tool0", "flange"])
def test_a_body_of_a_usual_name_is_found_without_being_named(tmp_path, ball_anatomy, cone, name) -> None:
    scene = built(tmp_path, MJCF.format(tool=f'<body name="{name}" {FRAME}/>'), ball_anatomy, cone)
    assert scene.notices == ()


def test_a_flange_that_there_is_not_is_told_with_what_there_is(tmp_path, ball_anatomy, cone) -> None:
    text = MJCF.format(tool='<site name="end"/>')
    with pytest.raises(ArmError, match="named 'nose'.*sites: end; bodies: post, upper, fore, hand.*`flange`"):
        built(tmp_path, text, ball_anatomy, cone, flange="nose")
    with pytest.raises(ArmError, match="no joint moves the body post"):
        built(tmp_path, text, ball_anatomy, cone, flange="post")
    with pytest.raises(ArmError, match="no joint moves the body world"):
        built(tmp_path, text, ball_anatomy, cone, flange="world")


def test_a_urdf_is_the_arm_that_its_mjcf_is(tmp_path, ball_anatomy, cone, ball_distance) -> None:
    scene = built(tmp_path, urdf(), ball_anatomy, cone, name="arm.urdf")
    search = IkSearch(scene, Clearance(scene, ball_distance))
    assert search.chain.names == ["turn", "lift", "bend", "roll", "nod"]
    assert search.search(TOP_M, DOWN).is_reached.all()
    mjcf = built(tmp_path, MJCF.format(tool=f'<site name="flange" {FRAME}/>'), ball_anatomy, cone)
    other = IkSearch(mjcf, Clearance(mjcf, ball_distance)).chain
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (20, 5))
    np.testing.assert_allclose(search.chain.forward(q).tips_m, other.forward(q).tips_m, atol=1e-7)
    np.testing.assert_allclose(
        search.chain.forward(q).beams, other.forward(q).beams, atol=1e-6
    )  # rpy has 8 digits


@pytest.mark.parametrize("name", ["tool0", "flange", "hand"])
def test_a_link_of_a_urdf_that_no_joint_moves_can_be_named(tmp_path, ball_anatomy, cone, name) -> None:
    tool = "spare" if name == "hand" else name
    scene = built(tmp_path, urdf(tool=tool), ball_anatomy, cone, name="arm.urdf", flange=name)
    # The hand's own frame has its x out of the arm, as a frame named flange has by ROS's convention.
    assert len(scene.notices) == (name == "hand")
    assert all("lies across the arm" in notice for notice in scene.notices)


def test_a_mimic_joint_of_a_urdf_is_a_coupled_joint(tmp_path, ball_anatomy, cone) -> None:
    with pytest.raises(ArmError, match="makes bend depend on lift"):
        built(
            tmp_path, urdf(mimic='<mimic joint="lift" multiplier="-2"/>'), ball_anatomy, cone, name="arm.urdf"
        )


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        (
            {"geometry": '<mesh filename="package://six/hand.stl"/>'},
            "'package:/six/hand.stl'. Put it there, or name",
        ),
        (
            {
                "geometry": '<mesh filename="hand.dae"/>',
                "head": '<mujoco><compiler meshdir="parts"/></mujoco>',
            },
            "hand.dae'. Put it there",
        ),
        (
            {"geometry": '<sphere radius="0"/>'},
            "size 0 must be positive in geom; Element name '', id 3.",
        ),
    ],
)
def test_what_keeps_mujoco_from_loading_a_urdf_is_told_whole(
    tmp_path, ball_anatomy, cone, parts, words
) -> None:
    with pytest.raises(ArmError) as caught:
        built(tmp_path, urdf(**parts), ball_anatomy, cone, name="arm.urdf")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("tool", "words"),
    [
        (
            '\n\n<geom name="pad" size="0"/>',
            "size 0 must be positive in geom; Element name 'pad', id 4, line 8.",
        ),
        (
            "\n<geom color='red'/>",
            "Schema violation: unrecognized attribute: 'color'; Element 'geom', line 7.",
        ),
        ("<site pos='0 0'/>", "'pos'"),
        ('<geom type="mesh" mesh="gone"/>', "gone"),
        (
            '<body><joint type="ball" range="1 2"/><geom size="0.01 1"/></body>',
            "range[0] should be 0 in ball joint",
        ),
        ("</body>", "Line number=2: XMLElement name=worldbody"),
    ],
)
def test_an_error_of_mujoco_names_the_element_and_the_line(tmp_path, ball_anatomy, cone, tool, words) -> None:
    with pytest.raises(ArmError) as caught:
        built(tmp_path, MJCF.format(tool=tool), ball_anatomy, cone)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)

"""Whatever MuJoCo loads becomes an arm or a sentence: keyframes, bystanders, numbers that are none, odd names."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from arm_files import ARM, BENT, FLANGE, KEY, MIDDLE, arm

from sim.episode.scenario import SCENARIOS
from sim.reach.workcell import build_workcell
from sim.world.ik.kinematics import Kinematics
from sim.world.ik.search import IkSearch
from sim.world.scene.arm import ArmError, ArmModel
from sim.world.scene.base_room import check_base_room
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import build_scene

TOP_M, DOWN = np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]])


@pytest.fixture(autouse=True)
def nothing_is_said_by_libraries(tmp_path, monkeypatch, capfd):
    """Neither on the terminal nor in a log file of MuJoCo, whatever a test loads."""
    folder = tmp_path / "present"
    folder.mkdir()
    monkeypatch.chdir(folder)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield
    assert capfd.readouterr() == ("", "")
    assert not list(folder.iterdir())


def reaches(scene, ball_distance) -> bool:
    """Whether the arm reaches the top of the ball, by the search and by what episodes ask."""
    clearance = Clearance(scene, ball_distance)
    found = IkSearch(scene, clearance).search(TOP_M, DOWN).is_reached[0]
    assert Kinematics(scene, clearance).solve(TOP_M[0], DOWN[0]).is_reached == found
    return bool(found)


@pytest.mark.parametrize(
    ("keys", "home_q", "words"),
    [
        ('<key qpos="0 -0.5 1.5 0 1 0"/>', BENT, None),  # an unnamed one is the first
        ('<key name="other" qpos="1 1 1 0 0 0"/>' + KEY.format(""), BENT, None),
        (KEY.format("") + '<key name="ready" qpos="1 1 1 0 0 0"/>', BENT, None),
        ('<key name="far"/><key name="near" qpos="0 -0.5 1.5 0 1 0"/>', MIDDLE, None),  # it has the zero position
        (KEY.format('ctrl="0 1"'), MIDDLE, "'home' is left out: its ctrl has 2 numbers in place of 0"),
        (KEY.format('qvel="0 1"'), MIDDLE, "its qvel has 2 numbers in place of 6"),
        (KEY.format('act="0 1"'), MIDDLE, "its act has 2 numbers in place of 0"),
        (KEY.format('mpos="0 1 2"'), MIDDLE, "its mpos has 3 numbers in place of 0"),
        (KEY.format('mquat="0 1 2 1"'), MIDDLE, "its mquat has 4 numbers in place of 0"),
        ('<key qpos="0 1"/>', MIDDLE, "number 1 is left out: its qpos has 2 numbers in place of 6"),
        ('<key qpos="0 1 0 0 0 0 0"/>', MIDDLE, "its qpos has 7 numbers"),
        ('<key qpos="0 nan 0 0 0 0"/>' + KEY.format(""), BENT, "number 1 is left out: its qpos"),
        ('<key qpos="0 inf 0 0 0 0"/>' + KEY.format(""), BENT, "holds what is no number"),
        (KEY.format("").replace("0 1 0", "0 9 0"), [*BENT[:4], np.deg2rad(120), 0], "nod is at 9, beyond its limits"),
    ],
)  # fmt: skip
def test_home_is_the_keyframe_that_fits_and_the_others_are_told(tmp_path, keys, home_q, words) -> None:
    loaded = arm(tmp_path, extra=f"<keyframe>{keys}</keyframe>").load()
    np.testing.assert_allclose(loaded.home_q, home_q, atol=1e-12)
    said = [notice for notice in loaded.notices if "MuJoCo says: XML contains a 'NaN'" not in notice]
    assert len(said) == (words is not None)
    assert all(words in notice and notice.startswith("arm.xml: ") for notice in said)


MOCAP = '<body name="target" mocap="true" pos="0.5 0 0.5"><geom name="box" type="box" size="0.05 0.05 0.05"/>{}</body>'
CUBE = '<body name="cube" pos="0.5 0 0.5"><freejoint/><geom name="cube" type="box" size="0.05 0.05 0.05"/></body>'


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"world": MOCAP.format("")}, ["the mocap body target is left out"]),
        ({"world": CUBE}, ["the free body cube is left out"]),
        ({"world": MOCAP.format("") + CUBE}, ["mocap body target", "free body cube"]),
        (  # all that refers to them goes too
            {
                "world": MOCAP.format('<site name="aim"/>')
                + CUBE
                + '<camera mode="targetbody" target="target"/><light mode="targetbody" target="cube"/>',
                "extra": '<equality><weld body1="target" body2="hand"/>'
                '<connect body1="cube" body2="hand" anchor="0 0 0"/>'
                "</equality><contact><exclude body1='cube' body2='hand'/><pair geom1='box' geom2='cube'/></contact>"
                "<tendon><spatial><site site='aim'/><site site='flange'/></spatial></tendon>"
                "<sensor><framepos objtype='body' objname='cube'/></sensor>"
                "<custom><tuple name='t'><element objtype='body' objname='cube'/></tuple></custom>"
                '<keyframe><key qpos="0 0 0 1 0 0 0 0 -0.5 1.5 0 1 0" mpos="0 0 1"/></keyframe>',
            },
            ["mocap body target", "free body cube"],
        ),
    ],
)
def test_mocap_targets_and_free_objects_are_left_out_and_told(
    tmp_path, ball_anatomy, cone, ball_distance, parts, words
) -> None:
    scene = build_scene(ball_anatomy, cone, arm=arm(tmp_path, **parts))
    assert [any(word in notice for word in words) for notice in scene.notices] == [True] * len(words)
    assert scene.model.nq == 6
    assert scene.model.neq == scene.model.nmocap == scene.model.ntendon == 0
    np.testing.assert_allclose(
        scene.home_q, BENT if "keyframe" in parts.get("extra", "") else MIDDLE, atol=1e-12
    )
    assert reaches(scene, ball_distance)


def test_an_arm_on_a_mocap_base_stands_still(tmp_path, ball_anatomy, cone, ball_distance) -> None:
    text = ARM.format(head="", world="", roll='range="-170 170"', flange=FLANGE, extra="")
    path = tmp_path / "arm.xml"
    path.write_text(text.replace('<body name="post">', '<body name="post" mocap="true">'))
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(path=path))
    assert "post carries the arm" in scene.notices[0]
    assert reaches(scene, ball_distance)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"world": '<site name="flange"/>', "flange": ""}, "no joint moves the site flange.*`flange`"),
        ({"flange": '<body><joint type="ball"/><geom size="0.1 1"/></body>' + FLANGE}, "free or ball joint"),
        ({"head": '<option><flag contact="enabled"/></option>'}, "flag.*line 1"),
        ({"roll": 'range="nan 1"'}, "the range of joint roll holds what is no number"),
        ({"world": '<body name="it" pos="0 0 850"><geom size="0.1 1"/></body>'}, "body it .*millimetres"),
        ({"flange": '<site name="flange" pos="0 0 500"/>'}, "site flange.*millimetres"),
        ({"flange": '<site name="flange" pos="0 nan 0"/>'}, "the pos of site flange holds what is no number"),
        ({"flange": FLANGE + '<geom size="0.01 1" pos="0 nan 0"/>'}, "moving bodies.*hand.*contains a 'NaN'"),
        (
            {"world": '<flexcomp name="cloth" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" radius="0.01"/>'},
            "a flex, cloth",
        ),
        ({"roll": 'type="slide" range="-1e300 1e300"'}, "roll slides without limits"),
        ({"flange": FLANGE + '<body name="dot"><joint/></body>'}, "mass and inertia of moving bodies.*dot"),
    ],
)  # fmt: skip
def test_what_cannot_be_an_arm_is_a_sentence(tmp_path, ball_anatomy, cone, parts, words) -> None:
    with pytest.raises(ArmError) as caught:
        build_scene(ball_anatomy, cone, arm=arm(tmp_path, **parts))
    assert re.search(words, str(caught.value))
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "parts",
    [
        {"head": '<option impratio="10" cone="elliptic" timestep="0.001" integrator="RK4"/>'},
        {
            "head": '<option gravity="0 0 -1.6" density="1.2" wind="1 0 0" o_margin="1"/><statistic extent="2"/>'
        },
        {"head": '<visual><headlight ambient="1 1 1"/><map znear="1"/><quality offsamples="8"/></visual>'},
        {"head": '<size memory="10M" nuserdata="3"/>'},
        {"head": '<option><flag gravity="disable" contact="disable" sleep="enable"/></option>'},
        {"head": '<compiler conflict="error"/><option impratio="10"/>'},
        {"roll": 'limited="false"'},
        {"roll": 'range="-40000 40000"'},
        {"world": '<geom type="plane" size="0 0 1"/><light pos="0 0 3"/><camera name="view" pos="0 0 2"/>'},
        {
            "flange": FLANGE
            + '<body><joint type="slide"/><geom type="sphere" size="0.005" pos="-0.01 0.06 0"/></body>'
        },
        {"extra": "<sensor><jointpos joint='roll'/></sensor><custom><numeric name='n' data='1'/></custom>"},
    ],
)
def test_odd_files_work_and_no_library_says_a_word(
    tmp_path, ball_anatomy, cone, ball_distance, parts
) -> None:
    scene = build_scene(ball_anatomy, cone, arm=arm(tmp_path, **parts))
    assert scene.notices == ()
    assert reaches(scene, ball_distance)


def test_a_time_step_that_nothing_can_be_simulated_with_is_replaced(tmp_path, ball_anatomy, cone) -> None:
    for timestep, said in (("0", 1), ("10", 1), ("1e-9", 1), ("0.001", 0)):
        scene = build_scene(ball_anatomy, cone, arm=arm(tmp_path, head=f'<option timestep="{timestep}"/>'))
        assert scene.model.opt.timestep == (0.002 if said else 0.001)
        assert len(scene.notices) == said


def test_an_unlimited_hinge_answers_as_one_with_wide_limits(
    tmp_path, ball_anatomy, cone, ball_distance
) -> None:
    answers = []
    for roll in ('limited="false"', 'range="-40000 40000"'):
        scene = build_scene(ball_anatomy, cone, arm=arm(tmp_path, roll=roll))
        answers.append(IkSearch(scene, Clearance(scene, ball_distance)).search(TOP_M, DOWN).q)
    np.testing.assert_array_equal(*answers)


UNNAMED = """<mujoco><compiler angle="degree" autolimits="true"/><default><geom type="capsule" size="0.03"/></default>
<worldbody><body><geom fromto="0 0 0.05 0 0 0.35"/><body pos="0 0 0.42"><joint axis="0 0 1" range="-170 170"/>
<joint axis="0 1 0" range="-120 120"/><geom fromto="0.02 0 0 0.38 0 0"/><body pos="0.45 0 0">
<joint axis="0 1 0" range="-150 150"/><geom fromto="0.02 0 0 0.33 0 0"/><body pos="0.4 0 0">
<joint axis="1 0 0" range="-170 170"/><joint axis="0 1 0" range="-120 120"/><geom type="sphere" size="0.025"/>
<site name="flange" quat="0.7071068 0 0.7071068 0"/></body></body></body></body></worldbody></mujoco>"""


def test_links_without_names_touch_as_others_do(tmp_path, ball_anatomy, cone, ball_distance) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(UNNAMED)
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(path=path))
    assert len(scene.arm_geoms) == 4 + 4  # the links, and the probe
    data = scene.new_data()
    data.qpos[:5] = [0.0, 1.2, 0.5, 0.0, 0.0]  # reaching down through the table
    assert Clearance(scene, ball_distance).collision(_placed(scene, data)) is not None
    data.qpos[:5] = [0.0, 0.0, 0.0, 0.0, 0.0]
    in_organ = build_scene(ball_anatomy, cone, arm=ArmModel(path=path, base_m=(0.1, 0.0, -0.36)))
    hit = Clearance(in_organ, ball_distance).collision(in_organ.new_data())
    assert hit is not None
    assert reaches(scene, ball_distance)


def _placed(scene, data):
    import mujoco

    mujoco.mj_kinematics(scene.model, data)
    return data


COLUMN = """<mujoco><compiler angle="degree" autolimits="true"/><default><geom type="capsule" size="0.03"/></default>
<worldbody><body name="post"><geom fromto="0 0 0.05 0 0 0.35"/><body name="column" pos="0 0 0.42">
<joint name="turn" axis="0 0 1" range="-170 170"/><geom {column}/><body name="shoulder">
<joint name="lift" axis="0 1 0" range="-120 120"/><geom fromto="0.02 0 0 0.38 0 0"/><body pos="0.45 0 0">
<joint axis="0 1 0" range="-150 150"/><geom fromto="0.02 0 0 0.33 0 0"/><body pos="0.4 0 0">
<joint axis="1 0 0" range="-170 170"/><joint axis="0 1 0" range="-120 120"/><geom type="sphere" size="0.025"/>
<site name="flange" quat="0.7071068 0 0.7071068 0"/></body></body></body></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("column", "depth_mm"),
    [
        ('fromto="0 0 -0.15 0 0 -0.37" size="0.07"', 20),  # down to 420 - 370 - 70 mm
        ('type="sphere" pos="0.1 0 -0.41" size="0.05"', 40),
        ('type="box" pos="0.1 0 -0.4" size="0.05 0.05 0.043"', 23),
        ('type="cylinder" pos="0.1 0 -0.4" size="0.05 0.0312"', 12),  # 11.2, and a whole number is enough
        ('type="ellipsoid" pos="0.1 0 -0.4" size="0.05 0.05 0.06"', 40),
    ],
)
def test_a_link_in_the_table_in_every_configuration_is_told_with_how_far_to_raise_the_base(
    tmp_path, ball_anatomy, cone, ball_distance, column, depth_mm
) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(COLUMN.format(column=column))
    with pytest.raises(ArmError, match="column stands in the table in every configuration") as caught:
        check_base_room(build_scene(ball_anatomy, cone, arm=ArmModel(path=path)), ball_distance)
    assert f"Raise the base by at least {depth_mm} mm (`base_mm`)" in str(caught.value)
    raised = ArmModel(path=path, base_m=(0.0, 0.0, depth_mm * 1e-3))
    check_base_room(build_scene(ball_anatomy, cone, arm=raised), ball_distance)


def test_the_same_holds_for_a_first_link_without_a_post(tmp_path, ball_anatomy, cone, ball_distance) -> None:
    """A turret that rests on the table is none of these, and one that pitches into it is seen where it does."""
    text = """<mujoco><compiler angle="degree" autolimits="true"/><worldbody><body name="turret">
    <joint name="turn" axis="{}" range="-90 90"/><geom type="cylinder" size="0.05 0.1" pos="0 0 {}"/>
    <body pos="0 0 0.3"><joint axis="0 1 0" range="-90 90"/><geom type="sphere" size="0.03"/>
    <site name="flange" pos="0 0 0.05"/></body></body></worldbody></mujoco>"""
    path = tmp_path / "turret.xml"
    path.write_text(text.format("0 0 1", 0.09))
    with pytest.raises(ArmError, match="turret stands in the table.*at least 10 mm"):
        check_base_room(build_scene(ball_anatomy, cone, arm=ArmModel(path=path)), ball_distance)
    path.write_text(text.format("0 0 1", 0.1))
    resting = build_scene(ball_anatomy, cone, arm=ArmModel(path=path))
    check_base_room(resting, ball_distance)
    assert Clearance(resting, ball_distance).collision(resting.new_data()) is None
    path.write_text(text.format("0 1 0", 0.15))
    pitching = build_scene(ball_anatomy, cone, arm=ArmModel(path=path))
    check_base_room(pitching, ball_distance)
    data = pitching.new_data()
    data.qpos[0] = 1.5
    hit = Clearance(pitching, ball_distance).collision(_placed(pitching, data))
    assert hit is not None
    assert "turret" in str(hit)


def test_links_that_always_overlap_each_other_are_told(tmp_path, ball_anatomy, cone, ball_distance) -> None:
    wrist = '<geom name="cuff" type="sphere" size="0.4" mass="0.1"/>'
    overlapping = arm(tmp_path, flange=wrist + FLANGE.replace("/>", ' pos="0.5 0 0"/>'), world="")
    with pytest.raises(
        ArmError, match="cuff and elbow overlap in every configuration|elbow and cuff overlap"
    ):
        check_base_room(build_scene(ball_anatomy, cone, arm=overlapping), ball_distance)


def test_a_link_that_is_always_in_the_organ_is_told(tmp_path, ball_anatomy, cone, ball_distance) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(COLUMN.format(column='type="sphere" pos="0.15 0 -0.34" size="0.03"'))
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(path=path, base_m=(0.35, 0.0, 0.0)))
    scene.model.jnt_range[0] = -0.3, 0.3
    with pytest.raises(ArmError, match="in the organ in every configuration.*`base_mm`"):
        check_base_room(scene, ball_distance)


def test_notices_about_the_file_reach_the_workcell(tmp_path) -> None:
    workcell = build_workcell(SCENARIOS["sphere"], arm(tmp_path, world=MOCAP.format("")))
    assert "mocap body target" in workcell.notices[-1]

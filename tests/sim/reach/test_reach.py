"""Reachability studies and explained poses, as people run them, checked by forward kinematics."""

from __future__ import annotations

import csv
import json
import re
import shlex
from pathlib import Path

import mujoco
import numpy as np
import pytest

from planner import Workspace
from sim.cli import ik, reach
from sim.cli.command_line import main, parse_command
from sim.episode.scenario_file import load_scenario
from sim.reach.explanation import explain_pose
from sim.reach.pose_pool import chunk_answers
from sim.reach.reachability import study_reach, tilted
from sim.reach.regions import contact_regions
from sim.reach.workcell import build_workcell
from sim.world.ik.search import Answers
from sim.world.scene.clearance import FAR_M
from sim.world.scene.named_arms import named_arm

ROOT = Path(__file__).resolve().parents[3]
GANTRY = """<mujoco><compiler angle="radian"/>
<default><default class="g"><geom size="0.02" contype="0" conaffinity="0"/></default></default>
<worldbody><body pos="0.5 0 1"><joint name="x" type="slide" axis="1 0 0" range="-0.3 0.3"/>
<geom class="g"/><body><joint name="y" type="slide" axis="0 1 0" range="-0.02 0.3"/><geom class="g"/>
<body><joint name="z" type="slide" axis="0 0 1" range="-0.9 0"/><geom class="g"/>
<body><joint name="tilt" axis="1 0 0" range="-1.6 1.6"/><geom class="g"/>
<body><joint name="lean" axis="0 1 0" range="-1.6 1.6"/><geom class="g"/>
<site name="flange" quat="0 1 0 0"/></body></body></body></body></body></worldbody></mujoco>"""
COARSE = 'base = "liver"\nn_poses = 60\n'


@pytest.fixture(scope="module")
def workcell(tmp_path_factory):
    path = tmp_path_factory.mktemp("case") / "coarse.toml"
    path.write_text(COARSE)
    return build_workcell(load_scenario(str(path)), named_arm("default"))


@pytest.fixture(scope="module")
def search(workcell):
    return workcell.make_search()


@pytest.fixture(scope="module")
def study(workcell, search):
    return study_reach(search, workcell.workspace, max_tilt_rad=np.deg2rad(15.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of a coarse liver, run once from the command line."""
    path = tmp_path_factory.mktemp("reach")
    (path / "coarse.toml").write_text(COARSE)
    arguments = [
        "reach",
        "--scenario",
        str(path / "coarse.toml"),
        "--out",
        str(path / "out"),
        "--tilt-deg",
        "15",
    ]
    assert main(arguments) == 0
    return path / "out"


def rows_of(folder) -> list[dict[str, str]]:
    with (folder / "reach.csv").open() as file:
        return list(csv.DictReader(file))


def test_the_folder_holds_a_row_per_pose_and_a_true_summary(folder) -> None:
    rows, summary = rows_of(folder), json.loads((folder / "summary.json").read_text())
    assert [int(row["pose_index"]) for row in rows] == list(range(summary["n_poses"]))
    reached = [row["is_reached"] == "1" for row in rows]
    assert summary["reached_fraction"] == pytest.approx(np.mean(reached))
    assert sum(summary["reasons"].values()) == summary["n_poses"]
    assert summary["poses_per_s"] > 0
    assert 0.8 < np.mean(reached) < 1.0  # the far margin is out of the arm's reach
    for row, is_reached in zip(rows, reached, strict=True):
        assert (row["reason"] == "reached") == is_reached
        assert (row["score"] != "") == is_reached
        assert is_reached or row["detail"]
    assert {file.name for file in folder.glob("*.png")} == {"reach.png", "reasons.png"}
    assert json.loads((folder / "manifest.json").read_text())["status"] == "finished"


def test_every_reached_row_holds_by_forward_kinematics(folder, workcell) -> None:
    model, data = workcell.scene.model, mujoco.MjData(workcell.scene.model)
    low, high = model.jnt_range.T
    for row in rows_of(folder):
        if row["is_reached"] == "0":
            continue
        q = np.array([float(row[f"joint{i}_rad"]) for i in range(1, 8)])
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        position_m = [float(row[f"position_{axis}_m"]) for axis in "xyz"]
        normal = np.array([float(row[f"normal_{axis}"]) for axis in "xyz"])
        assert np.linalg.norm(data.site("probe_tip").xpos - position_m) < 1e-3
        beam = data.site("probe_tip").xmat.reshape(3, 3)[:, 2]
        assert np.linalg.norm(np.cross(beam, normal)) < np.sin(np.deg2rad(1.0))
        assert np.all((q >= low) & (q <= high))
        room = float(row["joint_limit_distance_rad"])
        assert room == pytest.approx(np.minimum(q - low, high - q).min())
        assert workcell.clearance.collision(data) is None
        assert 0.0 <= float(row["clearance_m"]) <= FAR_M


def test_a_study_never_overwrites_unasked(folder, capsys) -> None:
    before = (folder / "reach.csv").read_bytes()
    assert main(["reach", "--scenario", "liver", "--out", str(folder)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (folder / "reach.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["reach", "--arm", "none"], "free-flying probe reaches every pose"),
        (["reach", "--arm", "nowhere.xml"], "nowhere.xml: no such arm file"),
        (["reach", "--tilt-deg", "95"], "--tilt-deg 95.0: must be from 0 to 80"),
        (["reach", "--restarts", "500"], "--restarts 500: must be from 0 to 119"),
        (["reach", "--scenario", "kidney"], "scenario 'kidney'"),
        (["ik", "--position-mm", "0", "0", "1e9"], "at most 10000 mm"),
        (["ik", "--position-mm", "500", "0", "nan"], "finite"),
        (["ik", "--position-mm", "500", "0", "100", "--normal", "0", "0", "0"], "not all zero"),
        (["ik", "--position-mm", "500", "0", "100", "--arm", "none"], "Name an arm"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, words, capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert "\n" not in error
    assert not list(tmp_path.iterdir())


def test_a_reached_pose_is_explained_with_all_joints(workcell, study) -> None:
    pose = int(np.flatnonzero(study.is_reached)[0])
    position_m, normal = workcell.workspace.positions_m[pose], 2.0 * workcell.workspace.normals[pose]
    explanation = explain_pose(workcell, position_m, normal, standoff_m=0.04)
    assert explanation.is_reached
    assert "answer           reached" in explanation.text
    assert "on the organ's surface" in explanation.text
    assert all(f"joint{i}" in explanation.text for i in range(1, 8))
    assert "clearance" in explanation.text


def test_a_pose_inside_the_organ_and_one_in_metres_say_so(workcell, capsys) -> None:
    inside = explain_pose(workcell, (0.5, 0.0, 0.1), (0.0, 0.0, -1.0), standoff_m=0.04)
    assert not inside.is_reached
    assert "inside the organ" in inside.text
    assert "probe_" in inside.text  # the pair that collides
    main(["ik", "--scenario", "sphere", "--position-mm", "0.5", "0", "0.1"])
    assert "given in metres?" in capsys.readouterr().out


def test_an_unreached_pose_ends_with_exit_code_1(capsys) -> None:
    assert main(["ik", "--position-mm", "1500", "0", "100", "--normal", "0", "0", "-1"]) == 1
    assert "beyond the stretched arm" in capsys.readouterr().out


def test_an_organ_out_of_reach_is_studied_and_the_likely_mistake_is_named(tmp_path, capsys) -> None:
    """Its place was given in millimetres: 500 m away."""
    (tmp_path / "far.toml").write_text(
        COARSE + "organ_position_m = [500.0, 0.0, 0.0]\norgan_quaternion = [1.0, 0.0, 0.0, 0.0]\n"
    )
    out = tmp_path / "out"
    assert (
        main(["reach", "--scenario", str(tmp_path / "far.toml"), "--out", str(out), "--tilt-deg", "10"]) == 0
    )
    assert "no pose is reached. The organ's middle is 500" in capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["reached_fraction"], summary["n_regions"]) == (0.0, 0)
    assert set(summary["reasons"]) == {"too_far"}


def test_tilting_only_adds_poses(study) -> None:
    assert np.array_equal(study.tilt_rad == 0.0, study.is_reached)
    added = study.tilt_rad[~study.is_reached]
    assert np.isfinite(added).any()  # the far margin needs a few degrees
    assert set(np.round(np.rad2deg(added[np.isfinite(added)]), 6)) <= {7.5, 15.0}


def test_the_number_of_processes_changes_no_byte(workcell, search) -> None:
    workspace, chunks = workcell.workspace, [slice(0, 20), slice(20, 40)]
    with chunk_answers(search, workspace, chunks, n_jobs=1) as answers:
        alone = Answers.joined(list(answers))
    with chunk_answers(search, workspace, chunks, n_jobs=2) as answers:
        shared = Answers.joined(list(answers))
    assert alone.q.tobytes() == shared.q.tobytes()
    assert alone.is_reached.tolist() == shared.is_reached.tolist()


def test_tilted_directions_are_at_the_angle() -> None:
    normals = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.6, 0.0, -0.8]])
    directions = tilted(normals, 0.3, 5)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1.0)
    np.testing.assert_allclose(np.einsum("nki,ni->nk", directions, normals), np.cos(0.3))


def test_regions_are_parted_where_the_arm_cannot_slide_across(workcell) -> None:
    """Two rows of poses 10 mm apart, and a third far off: one region each, the larger first, none where not reached."""
    x, y = np.meshgrid(np.linspace(0.45, 0.55, 11), [0.30, 0.31])
    near_m = np.column_stack([x.ravel(), y.ravel(), np.full(22, 0.2)])
    positions_m = np.vstack([near_m, near_m[:6] - [0.0, 0.6, 0.0], [[5.0, 0.0, 0.0]]])
    workspace = Workspace(positions_m, np.tile([0.0, 0.0, -1.0], (29, 1)))
    search = workcell.make_search()
    answers = search.search(workspace.positions_m, workspace.normals)
    assert answers.is_reached.tolist() == [True] * 28 + [False]
    region = contact_regions(search, workspace, answers.q, answers.is_reached, answers.clearance_m)
    assert region.tolist() == [0] * 22 + [1] * 6 + [-1]


def test_any_arm_is_studied_and_its_limits_hold(tmp_path, workcell) -> None:
    """A gantry of slides and two hinges that reaches one half of the organ: the answer is known from its rails."""
    path = tmp_path / "gantry.xml"
    path.write_text(GANTRY)
    gantry = build_workcell(workcell.scenario, named_arm(str(path)))
    study = study_reach(gantry.make_search(), gantry.workspace)
    flange_y_m = gantry.workspace.positions_m[:, 1] - 0.16 * gantry.workspace.normals[:, 1]
    assert not study.is_reached[flange_y_m < -0.02 - 1e-3].any()
    assert study.is_reached[flange_y_m > 0.0].any()
    assert "joint_limit" in study.reasons()
    assert study.n_solutions.max() == 1  # five joints, five conditions


def test_the_pages_commands_are_understood_and_its_modules_exist() -> None:
    page = (ROOT / "docs" / "reach.md").read_text(encoding="utf-8")
    lines = [
        line for block in re.findall(r"```sh\n(.*?)```", page, flags=re.DOTALL) for line in block.splitlines()
    ]
    parsed = [parse_command(shlex.split(line, comments=True)[1:]) for line in lines]
    assert {type(options) for options in parsed} == {reach.Options, ik.Options}
    named = set(re.findall(r"`(?:sim/world/)?[a-z_/]*?([a-z_]+\.py)`", page))
    assert len(named) >= 4
    assert named <= {path.name for path in (ROOT / "sim" / "world").rglob("*.py")}

"""Where the base should stand: moved arms against rebuilt scenes, and searches whose winners are checked."""

from __future__ import annotations

import csv
import json
import re
import shlex

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.cli.command_line import main, parse_command
from sim.episode.scenario_file import load_scenario
from sim.reach.base_grid import Stand
from sim.reach.base_search import BaseQuestion, search_base
from sim.reach.reachability import reached_fraction
from sim.reach.workcell import build_workcell
from sim.running.placing.arm_place import arm_standing
from sim.world.scene.arm import ArmModel
from sim.world.scene.base_room import BaseRoom
from sim.world.scene.clearance import Clearance
from sim.world.scene.clearance_meter import ClearanceMeter
from sim.world.scene.named_arms import named_arm
from sim.world.scene.scene import build_scene

COARSE = 'base = "liver"\nn_poses = 60\n'
QUESTION = BaseQuestion(n_bases=14, n_poses=20, seed=3)


@pytest.fixture(scope="module")
def workcell(tmp_path_factory):
    """A coarse liver before an arm that stands badly: on the far corner of the table, and looks away."""
    path = tmp_path_factory.mktemp("case") / "coarse.toml"
    path.write_text(COARSE)
    return build_workcell(
        load_scenario(str(path)),
        named_arm("default", base_m=(-0.25, 0.35, 0.0), base_yaw_rad=np.deg2rad(90.0)),
    )


@pytest.fixture(scope="module")
def found(workcell):
    return search_base(workcell, workcell.make_search(), QUESTION)


@pytest.mark.parametrize("base", [(0.2, -0.4, 0.1, 2.0), (0.9, 0.3, 0.0, -3.0)])
def test_a_moved_search_equals_that_of_a_rebuilt_scene(
    ball_anatomy, cone, ball_distance, search, base
) -> None:
    moved = search.at_base(Stand(*base).T_world_base)
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(base_m=base[:3], base_yaw_rad=base[3]))
    meter = ClearanceMeter(scene, Clearance(scene, ball_distance))
    q = np.random.default_rng(0).uniform(*search.chain.search_range(), (30, 7))
    state, data = moved.chain.forward(q), scene.new_data()
    for i in range(len(q)):
        data.qpos[:] = q[i]
        mujoco.mj_kinematics(scene.model, data)
        np.testing.assert_allclose(state.tips_m[i], data.site("probe_tip").xpos, atol=1e-9)
    ours, theirs = moved.meter.measure(q), meter.measure(q)
    np.testing.assert_allclose(ours.contact_m, theirs.contact_m, atol=1e-9)
    np.testing.assert_allclose(ours.organ_m, theirs.organ_m, atol=1e-9)
    assert (ours.contact_m < 0.0).any()  # some of them lie in the table
    assert (search.meter.measure(q).organ_m != theirs.organ_m).any()  # the first search stays where it was


@settings(max_examples=12)
@given(
    x_m=st.floats(-0.2, 0.3),
    y_m=st.floats(-0.4, 0.4),
    z_m=st.floats(0.0, 0.3),
    yaw_rad=st.floats(-3.1, 3.1),
    slope=st.floats(-0.8, 0.8),
)
def test_what_is_reached_from_any_base_holds_by_forward_kinematics(
    ball_anatomy, cone, ball_distance, search, x_m, y_m, z_m, yaw_rad, slope
) -> None:
    position_m = np.array([0.5, 0.06 * np.sin(slope), 0.06 + 0.06 * np.cos(slope)])
    normal = -np.array([0.0, np.sin(slope), np.cos(slope)])
    moved = search.at_base(Stand(x_m, y_m, z_m, yaw_rad).T_world_base)
    result = moved.search(position_m[None], normal[None]).results[0]
    if not result.is_reached:
        return
    scene = build_scene(ball_anatomy, cone, arm=ArmModel(base_m=(x_m, y_m, z_m), base_yaw_rad=yaw_rad))
    data, clearance = scene.new_data(), Clearance(scene, ball_distance)
    low, high = scene.model.jnt_range.T
    for q, tip_m in ((result.q, position_m), (result.q_standoff, position_m - 0.04 * normal)):
        assert np.all((q >= low) & (q <= high))
        data.qpos[:] = q
        mujoco.mj_kinematics(scene.model, data)
        assert np.linalg.norm(data.site("probe_tip").xpos - tip_m) < 1e-3
        assert data.site("probe_tip").xmat.reshape(3, 3)[:, 2] @ normal > np.cos(np.deg2rad(1.0))
        assert clearance.collision(data) is None


def test_the_best_base_is_better_and_its_share_holds_in_a_study(workcell, found) -> None:
    present, best = found.candidates[0], found.best
    assert present.stage == "present"
    assert best.reached_fraction > 0.9 > present.reached_fraction
    arm = ArmModel(base_m=best.stand[:3], base_yaw_rad=best.stand.yaw_rad)
    rebuilt = workcell.with_arm(arm)
    share = reached_fraction(rebuilt.make_search(), rebuilt.workspace)
    assert share == pytest.approx(best.reached_fraction, abs=0.12)  # 20 of 60 poses, drawn


def test_every_base_asked_has_room_and_the_others_say_why_not(workcell, found) -> None:
    base_room = BaseRoom(workcell.scene, workcell.organ_distance)
    assert len(found.asked) == QUESTION.n_bases
    assert {candidate.stage for candidate in found.asked} == {"present", "grid", "refined"}
    for candidate in found.candidates:
        assert (base_room.obstacle(candidate.stand.T_world_base) is None) == (not candidate.obstacle)
        assert np.isnan(candidate.reached_fraction) == bool(candidate.obstacle)
    assert all(0.0 <= candidate.stand.z_m <= 0.3 for candidate in found.asked)


def test_the_number_of_processes_changes_nothing(workcell, found) -> None:
    shared = search_base(
        workcell, workcell.make_search(), BaseQuestion(n_bases=14, n_poses=20, seed=3, n_jobs=2)
    )
    assert repr(shared.candidates) == repr(found.candidates)


def test_the_objective_chooses(found) -> None:
    seen = BaseQuestion(objective="seen")
    best = max(found.asked, key=seen.merit)
    assert best.seen_fraction == max(candidate.seen_fraction for candidate in found.asked)
    assert 0.0 < best.seen_fraction <= 1.0


def test_a_base_in_the_table_or_the_organ_has_no_room(workcell) -> None:
    base_room = BaseRoom(workcell.scene, workcell.organ_distance)
    assert base_room.obstacle(Stand(0.0, 0.0, 0.0, 0.0).T_world_base) is None
    assert "in the table, 50 mm below" in str(base_room.obstacle(Stand(0.0, 0.0, -0.05, 0.0).T_world_base))
    assert "in the organ" in str(base_room.obstacle(Stand(0.45, 0.0, 0.0, 1.0).T_world_base))
    assert (
        base_room.obstacle(Stand(0.3, -0.8, -0.3, 0.0).T_world_base) is None
    )  # beside the table, on a stand


def test_the_command_writes_its_table_and_says_what_to_type(tmp_path, capsys) -> None:
    (tmp_path / "coarse.toml").write_text(COARSE)
    out = tmp_path / "out"
    arguments = ["--scenario", str(tmp_path / "coarse.toml"), "--base-search", "10", "--base-poses", "20"]
    badly = ["--base-mm", "-250", "350", "0", "--base-yaw-deg", "90"]
    assert main(["reach", *arguments, *badly, "--out", str(out)]) == 0
    text = capsys.readouterr().out
    summary = json.loads((out / "summary.json").read_text())
    with (out / "bases.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if not row["obstacle"]]
    assert len(rows) == summary["base_search"]["n_bases"] == 10
    assert rows[0]["stage"] == "present"
    ranked = sorted((float(row["reached_fraction"]) for row in rows), reverse=True)
    assert summary["base_search"]["best_reached_fraction_by_sample"] >= ranked[2]  # of the best three
    assert summary["base_search"]["best_reached_fraction"] > summary["reached_fraction"]
    assert (out / "bases.png").stat().st_size > 10_000
    best = summary["base_search"]["best_base"]
    (options,) = re.findall(r"to put the base there: (.*)", text)
    placed = parse_command(["reach", *shlex.split(options)])
    assert (list(placed.base_mm), placed.base_yaw_deg) == (best["base_mm"], best["base_yaw_deg"])
    arm = arm_standing("default", None, base_mm=placed.base_mm, base_yaw_deg=placed.base_yaw_deg)
    assert arm.base_m == pytest.approx([summary["base_search"][f"best_{axis}_m"] for axis in "xyz"], abs=1e-9)
    assert arm.base_yaw_rad == pytest.approx(summary["base_search"]["best_yaw_rad"], abs=1e-9)

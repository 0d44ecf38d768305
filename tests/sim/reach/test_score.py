"""Scores of reached poses, the stand-off of a study, and bases at the table's edge."""

import csv
import json

import numpy as np
import pytest

from sim.cli.command_line import main
from sim.episode.scenario_file import load_scenario
from sim.errors import FieldError
from sim.reach.base_grid import Stand
from sim.reach.score import PoseScore
from sim.reach.workcell import build_workcell
from sim.world.scene.base_room import BaseRoom
from sim.world.scene.named_arms import named_arm

COARSE = 'base = "liver"\nn_poses = 60\n'


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    path = tmp_path_factory.mktemp("case") / "coarse.toml"
    path.write_text(COARSE)
    return path


@pytest.fixture(scope="module")
def workcell(scenario):
    return build_workcell(load_scenario(str(scenario)), named_arm("default"))


def test_a_stretched_arm_scores_nothing_though_limits_and_obstacles_are_far(workcell) -> None:
    """150 poses of the liver once scored 1.0 with a manipulability among the lowest twentieth."""
    chain = workcell.make_search().chain
    # Joints 4 and 6 at these angles put elbow, wrist and shoulder in one line, half a degree from the limit's side.
    stretched = np.array([[0.0, 0.5, 0.0, -0.0698, 0.0, 1.5, 0.0]])
    bent = np.array([[0.3, 0.4, 0.2, -1.8, 0.3, 2.2, 0.4]])
    score = PoseScore(chain)
    far_m = np.array([0.1])
    assert score(bent, far_m)[0] == 1.0
    assert score(stretched, far_m)[0] < 0.1
    aligned = np.array([[0.0, 0.0, 0.0, -1.5, 0.0, 0.4, 0.0]])
    expected = chain.manipulability(aligned) / score.usual_manipulability
    assert chain.limit_room(aligned).min() > 0.3  # nothing but manipulability is left to lower the score
    assert score(aligned, far_m) == pytest.approx(np.minimum(expected, 1.0))


def test_the_usual_manipulability_is_the_arms_own_and_repeats(workcell) -> None:
    chain = workcell.make_search().chain
    usual = PoseScore(chain).usual_manipulability
    assert usual == PoseScore(chain).usual_manipulability
    low, high = chain.search_range()
    other = chain.manipulability(np.random.default_rng(7).uniform(low, high, (20_000, chain.n_joints)))
    # The median of 4,000 draws has a standard error of some 2 %.
    assert usual == pytest.approx(np.median(other), rel=0.08)


def test_a_study_takes_the_stand_off_that_is_asked_for(scenario, tmp_path, capsys) -> None:
    shares = {}
    for standoff in ("0", "40", "200"):
        out = tmp_path / standoff
        command = [
            "reach",
            "--scenario",
            str(scenario),
            "--jobs",
            "1",
            "--standoff-mm",
            standoff,
            "--out",
            str(out),
        ]
        assert main(command) == 0
        summary = json.loads((out / "summary.json").read_text())
        assert summary["standoff_m"] == float(standoff) * 1e-3
        shares[standoff] = summary["reached_fraction"]
    capsys.readouterr()
    assert shares["0"] >= shares["40"] > shares["200"]


def test_a_stand_off_out_of_range_is_refused() -> None:
    from sim.cli.reach import Options

    with pytest.raises(FieldError, match="from 0 to 500 mm"):
        Options(standoff_mm=-1.0)


def test_padding_is_kept_in_the_summary_and_refused_out_of_range(scenario, tmp_path, capsys) -> None:
    out, words = tmp_path / "padded", ["--scenario", str(scenario), "--jobs", "1", "--padding-mm", "20"]
    assert main(["reach", *words, "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["padding_m"] == pytest.approx(0.02)
    clearances_m = [row["clearance_m"] for row in csv.DictReader((out / "reach.csv").open())]
    assert min(float(each) for each in clearances_m if each) >= 0.02
    assert main(["ik", "--position-mm", "500", "0", "150", "--padding-mm", "31"]) == 2
    assert "--padding-mm 31: must be from 0 to 30 mm" in capsys.readouterr().err


def test_a_base_across_the_tables_edge_is_told_from_one_on_it_or_beside_it(workcell) -> None:
    room = BaseRoom(workcell.scene, workcell.organ_distance)
    on_it, beside, across = ((0.0, 0.0), (0.0, 0.8), (0.0, 0.45))
    assert room.overhang_m(Stand(*on_it, 0.0, 0.0).T_world_base) == 0.0
    assert room.overhang_m(Stand(*beside, 0.0, 0.0).T_world_base) == 0.0
    # The foot is a cylinder of 78 mm radius whose axis then stands on the edge, y = 0.45 m.
    assert room.overhang_m(Stand(*across, 0.0, 0.0).T_world_base) == pytest.approx(0.078, abs=0.001)

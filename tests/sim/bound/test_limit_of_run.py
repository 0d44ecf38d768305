"""A single run beside the limit: the hindsight optimum of its own seed, in summary, page and comparison."""

from __future__ import annotations

import csv
import json
import shutil

import pytest

from sim.bound.folder import BOUND, SEEDS
from sim.bound.limit import limit_of_run
from sim.cli.command_line import main
from sim.comparison.compare import compare
from sim.running.run_episode import run_episode


def options(folder):
    return json.loads((folder / "config.json").read_text())["options"]


@pytest.fixture(scope="module")
def runs(small_world, tmp_path_factory):
    """Runs of seed 1, which the bound knows, to 95 %, and of seed 7, which it does not know."""
    folder = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.pictures.run_figures.draw_run_figures", lambda *_: None)
        for name, seed in (("one", 1), ("seven", 7)):
            run_episode(
                scenario=str(small_world), planner="greedy-coverage", seed=seed, arm="none", motion="none", steps=60,
                until_sensed=0.95, out=folder / name, report=False, show_progress=False,
            )  # fmt: skip
    return folder


def hindsight(bound, seed):
    (row,) = [row for row in csv.DictReader((bound / SEEDS).open()) if int(row["seed"]) == seed]
    return int(row["least"])


def test_the_page_and_the_summary_hold_a_run_against_the_optimum_of_its_seed(runs, small_bound, tmp_path):
    run = shutil.copytree(runs / "one", tmp_path / "one")
    before = json.loads((run / "summary.json").read_text())
    assert main(["report", str(run), "--bound", str(small_bound)]) == 0
    summary = json.loads((run / "summary.json").read_text())
    limit = summary.pop("limit")
    # Nothing else of the summary changes.
    assert summary == before
    least = hindsight(small_bound, 1)
    assert limit["in_hindsight"] == least
    assert limit["is_possible"] is True
    bound = json.loads((small_bound / BOUND).read_text())
    assert limit["least_mean"] == pytest.approx(bound["policy"]["generator"]["least_mean"])
    page, ratio = (run / "report.html").read_text(), summary["sensings_to_95"] / least
    assert f"<dd>{ratio:.1f} ×</dd><dt>times the least possible</dt>" in page
    assert f"{ratio:.1f} times the least possible" in page
    # What was kept once stays, without the bound at hand.
    assert main(["report", str(run)]) == 0
    assert "times the least possible" in (run / "report.html").read_text()


def test_of_a_seed_that_the_bound_does_not_know_only_the_mean_is_told(runs, small_bound, tmp_path):
    run = shutil.copytree(runs / "seven", tmp_path / "seven")
    assert main(["report", str(run), "--bound", str(small_bound)]) == 0
    limit = json.loads((run / "summary.json").read_text())["limit"]
    assert (limit["in_hindsight"], limit["is_possible"]) == (None, None)
    page = (run / "report.html").read_text()
    assert f"<dd>{limit['least_mean']:.2f}</dd><dt>least mean of any planner</dt>" in page
    assert "the least possible for this seed is not known" in page


def test_runs_side_by_side_stand_beside_the_limit_and_stay_as_they_are(runs, small_bound, tmp_path):
    before = (runs / "one" / "summary.json").read_bytes()
    text = compare([runs / "one", runs / "seven"], tmp_path / "both", bound=[small_bound]).text
    assert f"| least possible, in hindsight | {hindsight(small_bound, 1)} | – |" in text
    assert (runs / "one" / "summary.json").read_bytes() == before
    page = (tmp_path / "both" / "report.html").read_text()
    assert "with the truth known" in page
    without = compare([runs / "one", runs / "seven"], tmp_path / "without").text
    assert "least possible" not in without


def test_a_bound_is_of_a_run_whose_organ_tumours_and_arm_it_has(runs, small_bound):
    of_run = options(runs / "one")
    assert limit_of_run([small_bound], of_run) is not None
    assert limit_of_run([small_bound], of_run | {"planner": "random", "steps": 3}) is not None
    others = (
        *(
            {"n_tumours": 2},
            {"arm": "default"},
            {"cone_depth_mm": 40.0},
            {"motion": "servo"},
            {"sense": "sweep"},
        ),
        *({"tissue": "elastic"}, {"breathing_mm": 8.0}, {"tracking_deg": 1.0}, {"registration_mm": 5.0}),
    )
    assert [limit_of_run([small_bound], of_run | other) for other in others] == [None] * len(others)


def test_a_bound_of_another_case_and_a_folder_without_a_run_are_refused(runs, small_bound, tmp_path, capsys):
    run = shutil.copytree(runs / "one", tmp_path / "one")
    config = json.loads((run / "config.json").read_text())
    config["options"]["n_tumours"] = 2
    (run / "config.json").write_text(json.dumps(config))
    assert main(["report", str(run), "--bound", str(small_bound)]) == 2
    assert "--bound" in (said := capsys.readouterr().err)
    assert "is not of the case of" in said
    config["options"] |= {"n_tumours": 1, "sense": "sweep"}
    (run / "config.json").write_text(json.dumps(config))
    assert main(["report", str(run), "--bound", str(small_bound)]) == 2
    assert "it ran with sense sweep" in capsys.readouterr().err
    assert main(["report", str(tmp_path), "--bound", str(small_bound)]) == 2
    assert "holds no run of `sounding episode` that came to its end" in capsys.readouterr().err

"""Plugs in campaigns: what is named by text goes through study, journal and workers, and may break without harm."""

from __future__ import annotations

import csv
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from campaign_plugs import MENDED, lay_out
from own_plugs import add_package

import sounding
from sim.campaign.journal import read_entries
from sim.campaign.study_file import load_study
from sim.cli.command_line import main

STUDY = """
[episode]
scenario = "ball.toml"
arm = "none"
motion = "none"
steps = 4
sensor = "own_parts:Forgetful"
sensor-option = ["miss_rate=0.3"]
map = "own_parts:Shares"
map-option = ["weight=0.5"]
[axes]
seed = "0:3"
[[part]]
axes.planner = ["own_parts:Backwards", "random"]
[[part]]
episode.planner = "backwards"
episode.sensor = "forgetful"
episode.map = "shares"
[[part]]
episode.planner = "own_parts:Sure"
episode.until-confident = 0.7
episode.steps = 9
"""
"""A planner, a sensor and a map of one's own, by place and by the name of an entry point; and a rule to stop."""
BROKEN_STUDY = """
[episode]
scenario = "ball.toml"
planner = "random"
arm = "none"
motion = "none"
steps = 3
[axes]
seed = "0:2"
[[part]]
axes.planner = ["random", "gone:Gone", "broken:Refuses", "broken:Tires", "broken:Quits", "broken:Boasts"]
[[part]]
episode.sensor = "broken:Falls"
[[part]]
axes.map = ["broken:Overflows", "broken:Vague"]
"""
QUITTING = """
import sys
import sounding

class Quits(sounding.Planner):
    needs_belief = False

    def rank(self, situation):
        sys.exit("enough")
"""
ERRORS = {
    "gone:Gone": "PlugError: `planner` 'gone:Gone': there is no module gone, neither installed nor in the current",
    "broken:Refuses": "PlugError: `planner` 'broken:Refuses' raised RuntimeError: no licence (broken.py, line 13)",
    "broken:Tires": "ZeroDivisionError: tired",
    "broken:Quits": "SystemExit: enough",
    "broken:Boasts": "ValueError: Boasts.confidence returned <object object at",
    "broken:Falls": "KeyError: 'cable'",
    "broken:Overflows": "OverflowError: too many points",
    "broken:Vague": "ValueError: Vague.predict_lattice returned latent means or variances that are no finite",
}
"""What the rows of plugs that break begin to say."""
TIMED = {"plan_s", "ik_s", "move_s", "sense_s", "update_s", "setup_s", "render_s", "wall_s"}


@pytest.fixture(scope="module")
def user(tmp_path_factory) -> Path:
    """The current folder of a user with modules of their own, one of which is installed as a package too."""
    folder, site = tmp_path_factory.mktemp("user"), tmp_path_factory.mktemp("site")
    lay_out(folder)
    (folder / "study.toml").write_text(STUDY)
    (folder / "broken.toml").write_text(BROKEN_STUDY)
    for kind, name, value in (
        ("planner", "backwards", "own_parts:Backwards"),
        ("sensor", "forgetful", "own_parts:Forgetful"),
        ("map", "shares", "own_parts:Shares"),
    ):
        add_package(site, f"own_{kind}", f"sounding.{kind}s", {name: value})
    before = set(sys.modules)
    paths = [str(site), str(folder), os.environ.get("PYTHONPATH", "")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [str(site), *sys.path, str(folder)])
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
        patch.chdir(folder)
        # Figures take most of the time of so short a run, and nothing here looks at them.
        patch.setattr("sim.pictures.run_figures.draw_run_figures", lambda *_: None)
        yield folder
    for name in set(sys.modules) - before:
        if str(folder) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


@pytest.fixture(scope="module")
def campaign(user) -> Path:
    """The study's campaign, run by one process."""
    done = sounding.run_trials(load_study("study.toml"), "one", jobs=1)
    assert (done.n_trials, done.n_run, done.n_failed) == (12, 12, 0)
    return user / "one"


def table(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "trials.csv").open()))


def assert_same(folder: Path, other: Path) -> None:
    for name in ("trials.csv", "curves.npz"):
        assert (folder / name).read_bytes() == (other / name).read_bytes()


def test_rows_do_not_depend_on_the_number_of_processes(user, campaign) -> None:
    assert sounding.run_trials(load_study("study.toml"), "two", jobs=2).n_failed == 0
    assert_same(user / "two", campaign)


def test_rows_are_the_same_on_dask(user, campaign) -> None:
    pytest.importorskip("distributed", reason="needs the extra: pip install 'sounding[dask]'")
    assert sounding.run_trials(load_study("study.toml"), "dask", jobs=1, engine="dask").n_failed == 0
    assert_same(user / "dask", campaign)


def test_key_and_journal_hold_the_texts(campaign) -> None:
    entries = list(read_entries(campaign / "journal.jsonl"))
    keys = {trial.key for trial in load_study("study.toml").trials()}
    assert {json.dumps(entry["settings"], sort_keys=True) for entry in entries} == keys
    first = entries[0]["settings"]
    assert (first["planner"], first["sensor"], first["map"]) == (
        "own_parts:Backwards",
        "own_parts:Forgetful",
        "own_parts:Shares",
    )
    assert (first["sensor_option"], first["map_option"]) == (["miss_rate=0.3"], ["weight=0.5"])


def test_a_row_is_what_a_single_episode_says(user, campaign) -> None:
    summary = sounding.run_episode(
        scenario="ball.toml",
        planner="own_parts:Backwards",
        sensor="own_parts:Forgetful",
        sensor_option=["miss_rate=0.3"],
        tumour_map="own_parts:Shares",
        map_option=["weight=0.5"],
        arm="none",
        motion="none",
        steps=4,
        seed=2,
        out="single",
        report=False,
        show_progress=False,
    )
    row = table(campaign)[2]
    assert (row["planner"], row["seed"]) == ("own_parts:Backwards", "2")
    for name in ("sensed_fraction", "auprc", "log_loss", "brier_score", "tip_path_m"):
        assert float(row[name]) == summary[name]
    n_points = [int(step["n_points"]) for step in csv.DictReader((user / "single" / "steps.csv").open())]
    with np.load(user / "single" / "own_map.npz") as arrays:  # what the map's own `save` wrote
        assert arrays["n"] == 1.0 + 0.5 * sum(n_points)


def test_an_entry_point_leads_to_the_same_rows_as_the_place_behind_it(campaign) -> None:
    named = ("planner", "sensor", "map")
    rows = table(campaign)
    by_place, by_name = (
        [{key: value for key, value in row.items() if key not in named} for row in some]
        for some in (rows[:3], rows[6:9])
    )
    assert by_place == by_name
    assert [row["planner"] for row in rows[6:9]] == ["backwards"] * 3


def test_a_plug_that_breaks_fails_its_trial_and_no_other(user, capsys) -> None:
    """Missing, raising as it is made, or raising midway: a row says why, and `--retry-failed` heeds the mended one."""
    words = ["trials", "--study", "broken.toml", "--out", "broken", "--jobs", "1"]
    assert main(words) == 0
    told = capsys.readouterr().out
    assert "18 of 18 trials done, 18 of them by this call" in told
    assert "16 failed: their rows in trials.csv say why; --retry-failed runs them again" in told
    rows = table(user / "broken")
    for row in rows:
        plug = next((row[name] for name in ("planner", "sensor", "map") if ":" in row[name]), None)
        assert row["status"] == ("finished" if plug is None else "failed")
        assert row["error"].startswith(ERRORS[plug] if plug else "")
    tracebacks = [entry.get("traceback", "") for entry in read_entries(user / "broken" / "journal.jsonl")]
    assert sum("broken.py" in text for text in tracebacks) >= 8  # the line of the user's own file

    finished = [row for row in rows if row["status"] == "finished"]
    (user / "broken.py").write_text(MENDED)
    (user / "gone.py").write_text("from own_parts import Backwards as Gone\n")
    assert main([*words, "--retry-failed"]) == 0
    told = capsys.readouterr().out
    assert "18 of 18 trials done, 16 of them by this call" in told
    assert "failed" not in told
    again = table(user / "broken")
    assert [row["status"] for row in again] == ["finished"] * 18
    assert [row for row in again if row["planner"] == "random" and not row["sensor"] + row["map"]] == finished


def test_a_forecast_tells_of_a_plug_that_breaks(user, capsys) -> None:
    words = [
        "trials",
        "--scenario",
        "ball.toml",
        "--arm",
        "none",
        "--steps",
        "2",
        "--planner",
        "random",
        "lost:Lost",
    ]
    assert main([*words, "--trials", "3", "--jobs", "1", "--dry-run"]) == 0
    told = capsys.readouterr().out
    assert "6 trials" in told
    assert (
        "1 of the 2 combinations tried fail: PlugError: --planner 'lost:Lost': there is no module lost"
        in told
    )


@pytest.mark.parametrize("kind", ["planner", "sensor", "map"])
def test_an_episode_with_a_missing_plug_ends_with_one_line(user, capsys, kind) -> None:
    words = ["--scenario", "ball.toml", "--arm", "none", "--out", f"no-{kind}", f"--{kind}", "lost:Lost"]
    assert main(["episode", *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith(
        f"sounding: --{kind} 'lost:Lost': there is no module lost, neither installed nor in"
    )
    assert not (user / f"no-{kind}").exists()


def test_a_planner_given_in_memory_gets_the_map_that_it_prefers(user) -> None:
    """Whoever brings a planner brings its taste in maps: what config.json says of the map is as when it is named."""
    from own_parts import Backwards  # pyright: ignore[reportMissingImports]

    def map_of(name: str, planner: object, **options) -> dict:
        sounding.run_episode(
            scenario="ball.toml", planner=planner, arm="none", motion="none", steps=1, out=name, report=False,
            show_progress=False, **options,
        )  # fmt: skip
        config = json.loads((user / name / "config.json").read_text())
        return {"map": config["map"], "detail": config["detail"]}

    paper = map_of("by-name", "expected-improvement")
    calibrated = map_of("calibrated", "find-and-outline")
    assert paper["map"]["prior_prevalence"] != calibrated["map"]["prior_prevalence"]
    assert map_of("in-memory", sounding.make_planner("expected-improvement")) == paper
    assert map_of("own", Backwards()) == paper
    assert map_of("overruled", Backwards(), map_settings="calibrated") == calibrated
    config = json.loads((user / "own" / "config.json").read_text())
    assert config["options"]["planner"] == "own_parts:Backwards"


def test_a_planner_without_a_belief_is_as_confident_in_a_campaign_as_in_an_episode(campaign) -> None:
    """Its next poses are looked up ahead, in situations that never come; only time may depend on that."""
    rows = table(campaign)[9:]
    assert [row["planner"] for row in rows] == ["own_parts:Sure"] * 3
    assert [row["error"] for row in rows] == [""] * 3
    assert [row["n_sensings"] for row in rows] == ["3"] * 3  # 3 of 4 is above 0.7
    single = sounding.run_episode(
        scenario="ball.toml", planner="own_parts:Sure", sensor="own_parts:Forgetful", sensor_option=["miss_rate=0.3"],
        tumour_map="own_parts:Shares", map_option=["weight=0.5"], arm="none", motion="none", until_confident=0.7,
        steps=9, out="sure", report=False, show_progress=False,
    )  # fmt: skip
    assert single["n_sensings"] == 3
    assert float(rows[0]["confidence"]) == single["confidence"] == 0.75


def test_a_planner_that_ends_the_program_makes_no_run_that_is_done(user, capsys) -> None:
    (user / "quitting.py").write_text(QUITTING)
    words = ["episode", "--scenario", "spheres", "--planner", "quitting:Quits", "--arm", "none"]
    assert main([*words, "--no-report", "--frames", "none", "--out", "quits"]) == 1
    assert "code that was called ended the program (exit code enough)" in capsys.readouterr().err
    assert json.loads((user / "quits" / "manifest.json").read_text())["status"] == "failed"

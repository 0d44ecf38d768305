"""Campaigns: the same rows whatever runs them, and none lost or run twice whatever kills them."""

from __future__ import annotations

import csv
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
from engine_here import EngineHere

from sim.campaign.journal import decoded
from sim.cli.trials import Options, run_campaign
from sim.errors import UsageError

ROOT = Path(__file__).resolve().parents[3]
BALL = """
organ = "ball.stl"
organ_unit = "m"
n_tumours = 1
tumour_shape = "sphere"
tumour_radius_m = 0.010
n_poses = 60
score_spacing_m = 0.008
"""
STUDY = """
title = "tiny"
[episode]
scenario = "ball.toml"
arm = "none"
[axes]
planner = ["expected-improvement", "random"]
steps = [3]
seed = "0:4"
"""


def trials_command(study, out, *, n_jobs: int) -> list[str]:
    options = ["--study", str(study), "--out", str(out), "--jobs", str(n_jobs)]
    return [sys.executable, "-m", "sim.cli", "trials", *options]


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    """Eight trials of a few actions each on a small ball."""
    folder = tmp_path_factory.mktemp("study")
    trimesh.creation.icosphere(subdivisions=2, radius=0.04).export(folder / "ball.stl")
    (folder / "ball.toml").write_text(BALL)
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


@pytest.fixture(scope="module")
def campaign(study, tmp_path_factory) -> Path:
    """The study's campaign, run by one process."""
    out = tmp_path_factory.mktemp("campaigns") / "one"
    summary = run_campaign(Options(study=str(study), out=out, jobs=1))
    assert (summary.n_trials, summary.n_run, summary.n_failed) == (8, 8, 0)
    return out


@pytest.fixture
def here(monkeypatch) -> None:
    """Trials run in this process, where it is not the processes that a test is about."""
    monkeypatch.setattr("sim.campaign.campaign.make_engine", EngineHere)


def table(folder: Path, name: str = "trials.csv") -> list[dict[str, str]]:
    return list(csv.DictReader((folder / name).open()))


def assert_same(folder: Path, campaign: Path) -> None:
    for name in ("trials.csv", "curves.npz", "lesions.csv", "false_findings.csv"):
        assert (folder / name).read_bytes() == (campaign / name).read_bytes()


def n_lines(folder: Path) -> int:
    path = folder / "journal.jsonl"
    return len(path.read_bytes().splitlines()) if path.exists() else 0


def test_a_row_is_what_a_single_episode_says(study, campaign, tmp_path) -> None:
    from sim.running.run_episode import run_episode

    rows = table(campaign)
    assert [row["planner"] for row in rows] == ["expected-improvement"] * 4 + ["random"] * 4
    assert [int(row["seed"]) for row in rows] == [*range(4), *range(4)]
    summary = run_episode(
        scenario=str(study.parent / "ball.toml"),
        planner="expected-improvement",
        arm="none",
        steps=3,
        seed=3,
        out=tmp_path / "run",
        show_progress=False,
    )
    row = rows[3]
    timed = {"plan_s", "ik_s", "move_s", "sense_s", "update_s", "setup_s", "render_s", "wall_s"}
    assert set(summary) - timed - {"folder", "ended_by"} <= set(row)
    assert not timed & set(row)
    for name in ("sensed_fraction", "log_loss", "brier_score", "attainable_fraction", "visible_fraction"):
        assert float(row[name]) == summary[name]
    assert json.loads(row["n_points_per_tumour"]) == summary["n_points_per_tumour"]
    steps = table(tmp_path / "run", "steps.csv")
    curves = np.load(campaign / "curves.npz", allow_pickle=False)
    first, count = curves["first"][3], curves["count"][3]
    assert np.allclose(
        curves["sensed_fraction"][first : first + count], [float(s["sensed_fraction"]) for s in steps]
    )
    times = table(campaign, "timings.csv")
    assert [row["seed"] for row in times] == [row["seed"] for row in rows]
    assert all(float(row["wall_s"]) > 0 for row in times)


def test_the_truth_is_the_same_for_every_planner(campaign) -> None:
    rows = table(campaign)
    for mine, other in zip(rows[:4], rows[4:], strict=True):
        for name in ("seed", "attainable_fraction", "n_points_per_tumour", "n_occupied"):
            assert mine[name] == other[name]


def test_rows_do_not_depend_on_the_number_of_processes(study, campaign, tmp_path) -> None:
    run_campaign(Options(study=str(study), out=tmp_path / "out", jobs=2))
    assert_same(tmp_path / "out", campaign)


def test_rows_are_the_same_on_a_dask_cluster(study, campaign, tmp_path) -> None:
    """One worker will do: the tests of engines have two, of which one dies."""
    pytest.importorskip("distributed")
    run_campaign(Options(study=str(study), out=tmp_path / "out", jobs=1, engine="dask"))
    assert_same(tmp_path / "out", campaign)


@pytest.mark.slow
def test_rows_are_the_same_on_a_ray_cluster(study, campaign, tmp_path) -> None:
    pytest.importorskip("ray")
    run_campaign(Options(study=str(study), out=tmp_path / "out", jobs=2, engine="ray"))
    assert_same(tmp_path / "out", campaign)


def test_a_campaign_that_is_killed_goes_on_where_it_was(study, campaign, here, tmp_path) -> None:
    out = tmp_path / "out"
    command = trials_command(study, out, n_jobs=2)
    parent = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
    while n_lines(out) < 2:
        assert parent.poll() is None
        time.sleep(0.01)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    before = (out / "journal.jsonl").read_bytes()
    n_before = sum(decoded(line) is not None for line in before.splitlines(keepends=True))
    assert 2 <= n_before < 8
    summary = run_campaign(Options(study=str(study), out=out))
    assert summary.n_run == 8 - n_before
    journal = (out / "journal.jsonl").read_bytes()
    assert journal.startswith(before[: before.rindex(b"\n") + 1])
    assert len(journal.splitlines()) == 8  # none twice
    assert_same(out, campaign)


def test_a_line_written_by_half_is_run_again(study, campaign, here, tmp_path) -> None:
    out = copy_of(campaign, tmp_path)
    text = (out / "journal.jsonl").read_bytes()
    (out / "journal.jsonl").write_bytes(text[:-20])
    summary = run_campaign(Options(study=str(study), out=out, jobs=1))
    assert (summary.n_run, summary.n_damaged) == (1, 1)
    assert_same(out, campaign)


def test_a_finished_campaign_runs_nothing_and_a_study_may_grow(study, campaign, here, tmp_path) -> None:
    out = copy_of(campaign, tmp_path)
    assert run_campaign(Options(study=str(study), out=out)).n_run == 0
    assert_same(out, campaign)
    grown = run_campaign(Options(study=str(study), out=out, seeds="0:5", jobs=1))
    assert (grown.n_trials, grown.n_run) == (10, 2)
    assert [row for row in table(out) if int(row["seed"]) < 4] == table(campaign)


def test_another_study_s_folder_is_refused(study, campaign, tmp_path) -> None:
    before = (campaign / "journal.jsonl").read_bytes()
    with pytest.raises(UsageError, match="holds another study; this one has no trial.*`overwrite`"):
        run_campaign(Options(study=str(study), out=campaign, seeds="0:3"))
    with pytest.raises(UsageError, match="holds another study"):
        run_campaign(Options(study=str(study), out=campaign, until_sensed=0.5))
    assert (campaign / "journal.jsonl").read_bytes() == before


def test_other_input_files_and_other_code_are_refused(study, campaign, tmp_path) -> None:
    out = copy_of(campaign, tmp_path)
    content = json.loads((out / "study.json").read_text())
    content["machine"]["packages"]["numpy"] = "1.0"
    (out / "study.json").write_text(json.dumps(content))
    with pytest.raises(UsageError, match="another version .packages.*`any_version`"):
        run_campaign(Options(study=str(study), out=out))
    assert run_campaign(Options(study=str(study), out=out, any_version=True)).n_run == 0
    ball = study.parent / "ball.stl"
    shape = ball.read_bytes()
    ball.write_bytes(shape + b" ")
    try:
        with pytest.raises(UsageError, match="begun with another file .*ball.stl"):
            run_campaign(Options(study=str(study), out=out))
    finally:
        ball.write_bytes(shape)


def test_two_campaigns_at_once_are_kept_apart(study, campaign, tmp_path) -> None:
    from sim.campaign.campaign_folder import CampaignFolder

    with CampaignFolder(tmp_path), pytest.raises(UsageError, match="another campaign is writing there"):
        run_campaign(Options(study=str(study), out=tmp_path))


def test_a_trial_that_raises_is_a_row_and_the_campaign_goes_on(study, here, tmp_path) -> None:
    ball = BALL.replace('"ball.stl"', f'"{study.parent}/ball.stl"')
    (tmp_path / "big.toml").write_text(ball.replace("0.010", "0.09"))  # no place for such a tumour
    (tmp_path / "small.toml").write_text(ball)
    text = '[axes]\nscenario = ["big.toml", "small.toml"]\n[episode]\nsteps = 1\narm = "none"\nplanner = "random"'
    (tmp_path / "study.toml").write_text(text)
    options = Options(study=str(tmp_path / "study.toml"), out=tmp_path / "out", jobs=1)
    summary = run_campaign(options)
    assert (summary.n_run, summary.n_failed) == (2, 1)
    bad, good = table(tmp_path / "out")
    assert (bad["status"], bad["seed"], good["status"]) == ("failed", "0", "finished")
    assert "Error: " in bad["error"]
    assert run_campaign(options).n_run == 0
    assert run_campaign(Options(**vars(options) | {"retry_failed": True})).n_run == 1


def test_a_full_disk_keeps_what_was_done_and_says_so(study, tmp_path) -> None:
    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4000, resource.RLIM_INFINITY))

    out = tmp_path / "out"
    command = trials_command(study, out, n_jobs=1)
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, preexec_fn=limit, timeout=300)
    assert run.returncode == 2
    lines = (out / "journal.jsonl").read_bytes().splitlines(keepends=True)
    assert f"The {len(lines)} trials that ended before are kept: make room and call again" in run.stderr
    assert 1 <= len(lines) < 8
    assert all(decoded(line) for line in lines)


def test_folders_are_written_when_asked_for(study, campaign, here, tmp_path) -> None:
    options = Options(
        study=str(study), out=tmp_path / "out", seeds="2:3", planner=("random",), folders=True, jobs=1
    )
    run_campaign(options)
    (folder,) = (tmp_path / "out" / "trials").iterdir()
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["planner"], summary["seed"]) == ("random", 2)
    assert table(tmp_path / "out") == [table(campaign)[6]]


def test_parquet_holds_the_same_table(campaign) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    read = parquet.read_table(campaign / "trials.parquet").to_pylist()
    for row, written in zip(read, table(campaign), strict=True):
        assert row["sensed_fraction"] == float(written["sensed_fraction"])
        assert row["seed"] == int(written["seed"])


def copy_of(campaign: Path, tmp_path: Path) -> Path:
    out = tmp_path / "copy"
    out.mkdir()
    for name in ("journal.jsonl", "study.json"):
        (out / name).write_bytes((campaign / name).read_bytes())
    return out

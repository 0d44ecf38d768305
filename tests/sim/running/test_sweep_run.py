"""A run that senses along the way: its folder tells all readings, and options that do not go together are refused."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from shared_runs import N_SWEEPS as N_ACTIONS
from shared_runs import SWEEP_OPTIONS as OPTIONS

from sim.cli.command_line import main
from sim.episode.measures import NEVER
from sim.episode.setup import build_setup
from sim.findings.evidence import EpisodeWitness, Evidence
from sim.record.recording import read_recording
from sim.record.run_record import load_run
from sim.report.packing import Pack
from sim.report.view_data import view_data
from sim.running.fields import config_of
from sim.running.parts import make_parts
from sim.running.run_episode import make_episode


@pytest.fixture(scope="module")
def run(sweep_run):
    return sweep_run


@pytest.fixture(scope="module")
def episode():
    parts = make_parts(config_of({**OPTIONS, "steps": N_ACTIONS}))
    episode = make_episode(parts, build_setup(parts.scenario, parts.arm, parts.map_settings))
    witness = EpisodeWitness(episode, parts.map_settings.prior_prevalence)
    steps = []
    for step in episode.steps(N_ACTIONS):
        steps.append(step)
        witness.note()
    return episode, steps, witness.evidence()


def rows(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_tables_and_summary_tell_the_readings_of_each_action(run, episode) -> None:
    _, steps, _ = episode
    table, readings = rows(run / "steps.csv"), rows(run / "readings.csv")
    assert [int(row["n_readings"]) for row in table] == [step.sweep.n_readings for step in steps]
    assert len(readings) == sum(step.sweep.n_readings for step in steps) > N_ACTIONS
    summary = json.loads((run / "summary.json").read_text())
    assert summary["n_readings"] == len(readings)
    assert summary["n_lift_offs"] == sum(int(row["n_lift_offs"]) for row in table)
    assert summary["contact_path_m"] == pytest.approx(sum(float(row["contact_path_m"]) for row in table))
    assert summary["procedure_s"] == pytest.approx(sum(step.motion.motion_s for step in steps))
    for row, step in zip(table, steps, strict=True):
        times = [float(each["time_s"]) for each in readings if each["step"] == row["step"]]
        assert times == sorted(times)
        assert times[-1] == pytest.approx(step.motion.motion_s)


def test_a_folder_and_an_episode_without_one_find_the_same(run, episode) -> None:
    kept, seen = Evidence.of_record(load_run(run)), episode[2]
    np.testing.assert_array_equal(kept.first_seen, seen.first_seen)
    assert (kept.first_seen != NEVER).any()
    # The last pose of each action alone would not tell it.
    record = load_run(run)
    ends = [record.cone.contains(record.detection_points_m, T[:3, 3], T[:3, 2]) for T in record.T_world_probe]
    assert np.any(ends, axis=0).sum() < (kept.first_seen != NEVER).sum()


def test_a_recording_is_as_long_as_the_procedure(run, episode) -> None:
    recording = read_recording(run)
    assert recording.duration_s == pytest.approx(sum(step.procedure_s for step in episode[1]))
    assert recording.sensing_s == 0.0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--read-every-mm", "1"], "--read-every-mm 1.0: at 40 mm/s that is 40 readings a second"),
        (["--sweep-speed-mm-s", "900"], "must be from 1 to 250"),
        (["--arm", "default", "--motion", "servo"], "holds a force in a sweep. Name it (--press-n)"),
        (["--arm", "default", "--motion", "servo", "--press-n", "9"], "must be above 0 and below the 5 N"),
        (["--press-n", "2"], "--press-n 2.0: means nothing without --tissue elastic or --motion servo"),
        (["--registration-mm", "5"], "--registration-mm 5.0: does not go with --sense sweep"),
        (["--sensor", "ultrasound"], "tilts the probe for each reading"),
    ],
)
def test_what_a_sweep_cannot_do_is_refused(tmp_path, capsys, words, told) -> None:
    out = tmp_path / "run"
    arm = [] if "--arm" in words else ["--arm", "none"]
    assert main(["episode", "--sense", "sweep", *arm, *words, "--out", str(out)]) == 2
    text = " ".join(capsys.readouterr().err.split())
    assert told in text
    assert not out.exists()


def test_an_option_of_sweeps_means_nothing_without_one(tmp_path, capsys) -> None:
    assert main(["episode", "--read-every-mm", "5", "--out", str(tmp_path / "run")]) == 2
    assert "means nothing without --sense sweep" in " ".join(capsys.readouterr().err.split())


def test_a_recording_tells_the_trace_and_the_readings_by_time(run, episode) -> None:
    recording, steps = read_recording(run), episode[1]
    trace = recording.trace()
    lengths_m = np.linalg.norm(trace.pieces_m[:, 1] - trace.pieces_m[:, 0], axis=1)
    gone_m = sum(step.sweep.contact_path_m for step in steps)
    # Pieces are chords of ways with a place every 2 mm or so, of which several are one piece.
    assert 0.98 * gone_m <= lengths_m.sum() <= gone_m + 1e-9
    assert np.diff(trace.end_s).min() > 0.0
    first_s = steps[0].motion.motion_s + steps[1].motion.motion_s
    assert len(recording.read_m(first_s)) == sum(step.sweep.n_readings for step in steps[:2])
    assert len(recording.read_m(recording.duration_s)) == sum(step.sweep.n_readings for step in steps)
    assert (recording.trace(first_s).end_s <= first_s).all()


def test_a_report_has_the_trace_and_the_readings_of_each_action(run, episode) -> None:
    pack = Pack()
    told = view_data(load_run(run), pack)["trace"]
    counts = np.cumsum([step.sweep.n_readings for step in episode[1]])
    assert told["read"] == counts.tolist()
    assert told["ends"][-1] == len(read_recording(run).trace().end_s)
    assert told["ends"] == sorted(told["ends"])

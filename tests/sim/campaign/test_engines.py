"""Engines: every trial comes back once, whoever dies on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
import trial_work

from sim.campaign.engines.factory import make_engine
from sim.campaign.engines.local import LocalEngine
from sim.campaign.study import Part, Trial
from sim.errors import UsageError
from sim.running.fields import config_of

ROOT = Path(__file__).resolve().parents[3]


def trials(count: int, **options) -> list[Trial]:
    values = {name: (value,) for name, value in options.items()}
    return list(Part({"scenario": ("sphere",), "seed": range(count), **values}).trials())


def outcomes(engine, some: list[Trial]) -> dict[int, dict]:
    found = [outcome for outcome in engine.outcomes(some) if outcome is not None]
    rows = {outcome.trial.config.seed: outcome.result.row for outcome in found}
    assert len(found) == len(some) == len(rows)
    return rows


def test_a_trial_that_kills_its_process_twice_is_a_row_and_the_others_are_untouched() -> None:
    with LocalEngine(2, work=trial_work.deadly) as engine:
        rows = outcomes(engine, trials(8))
    assert rows.pop(trial_work.DEADLY_SEED)["status"] == "worker died"
    assert all(row["n_sensings"] == seed + 1 for seed, row in rows.items())


def test_a_process_killed_midway_costs_nothing(tmp_path) -> None:
    some = [Trial(config_of(seed=seed, organ=tmp_path / "marker")) for seed in range(6)]
    with LocalEngine(2, work=trial_work.deadly_once) as engine:
        rows = outcomes(engine, some)
    assert (tmp_path / "marker").exists()
    assert {row["status"] for row in rows.values()} == {"finished"}


def test_processes_that_cannot_start_stop_the_campaign() -> None:
    with LocalEngine(1, work=trial_work.hopeless) as engine, pytest.raises(UsageError, match="die at once"):
        outcomes(engine, trials(20))


def test_processes_end_with_the_campaign_s_own(tmp_path) -> None:
    """Nothing is left running after `kill -9`, which lets no process tidy up."""
    code = """
        import sys, time
        sys.path.insert(0, sys.argv[1])
        from sim.campaign.engines.local import LocalEngine
        from sim.campaign.study import Part
        import trial_work
        engine = LocalEngine(1, work=trial_work.own_id)
        trials = Part({"scenario": ("sphere",)}).trials()
        print(next(filter(None, engine.outcomes(trials))).result.row["process"], flush=True)
        time.sleep(600)
    """
    parent = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code), str(ROOT / "tests" / "helpers")],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    deadline = time.monotonic() + 120
    while is_alive(worker) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not is_alive(worker)


def is_alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def test_a_dask_cluster_survives_the_death_of_a_worker(tmp_path) -> None:
    pytest.importorskip("distributed")
    from sim.campaign.engines.dask_engine import DaskEngine

    some = [Trial(config_of(seed=seed, organ=tmp_path / "marker")) for seed in range(6)]
    with DaskEngine(2, None, work=trial_work.deadly_once) as engine:
        rows = outcomes(engine, some)
    assert (tmp_path / "marker").exists()
    assert {seed: row["n_sensings"] for seed, row in rows.items()} == {seed: seed + 1 for seed in range(6)}


def test_a_ray_cluster_survives_the_death_of_a_worker(tmp_path, monkeypatch) -> None:
    pytest.importorskip("ray")
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "tests" / "helpers"))  # where its workers find trial_work
    from sim.campaign.engines.ray_engine import RayEngine

    some = [Trial(config_of(seed=seed, organ=tmp_path / "marker")) for seed in range(6)]
    with RayEngine(2, None, work=trial_work.deadly_once) as engine:
        rows = outcomes(engine, some)
    assert (tmp_path / "marker").exists()
    assert {row["status"] for row in rows.values()} == {"finished"}


def test_an_address_without_a_cluster_is_refused() -> None:
    with pytest.raises(UsageError, match="goes with the engines dask"):
        make_engine("local", n_jobs=1, address="tcp://127.0.0.1:1")

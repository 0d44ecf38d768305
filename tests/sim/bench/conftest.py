"""A toy benchmark: two tasks of a few actions on the paper's organ, whose trials run in the tests' own process."""

from __future__ import annotations

from pathlib import Path

import pytest
from engine_here import EngineHere

from sim.bench.run import BenchSettings, run_bench
from sim.bench.tasks import SCENARIOS_DIR, Task, load_task

TASK = """
name = "{name}"
title = "A toy"
order = {order}
scenario = "sphere"
seeds = "7000:7003"
n_quick = 2
score = "{score}"
direction = "{direction}"
truth = ""

[episode]
arm = "none"
motion = "none"
steps = 3
map = "{map}"
"""


@pytest.fixture(scope="session")
def toys(tmp_path_factory) -> tuple[Task, ...]:
    """Two tasks, one scored by actions and one by the map."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "tasks").mkdir()
    (folder / "scenarios").mkdir()
    (folder / "scenarios" / "sphere.toml").write_bytes((SCENARIOS_DIR / "sphere.toml").read_bytes())
    scores = {
        "toy-v1": ("sensings_to_95", "lower", "when-needed"),
        "toy-map-v1": ("auprc", "higher", "always"),
    }
    for order, (name, (score, direction, kept)) in enumerate(scores.items()):
        text = TASK.format(name=name, order=order, score=score, direction=direction, map=kept)
        (folder / "tasks" / f"{name}.toml").write_text(text)
    return tuple(load_task(folder / "tasks" / f"{name}.toml") for name in scores)


@pytest.fixture
def here(monkeypatch) -> None:
    """Trials run in this process, where it is not the processes that a test is about."""
    monkeypatch.setattr("sim.campaign.campaign.make_engine", EngineHere)


@pytest.fixture(scope="session")
def submission(toys, tmp_path_factory) -> Path:
    """The folder of a quick run of random on the toys."""
    out = tmp_path_factory.mktemp("runs") / "random"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.campaign.campaign.make_engine", EngineHere)
        assert run_bench("random", toys, out, BenchSettings(quick=True)) is not None
    return out

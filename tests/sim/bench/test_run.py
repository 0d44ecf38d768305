"""A run of the benchmark goes on where it was killed, and takes no folder that is another's."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim.bench import run
from sim.bench.results import trial_scores
from sim.bench.run import BenchSettings, run_bench
from sim.bench.tasks import all_tasks
from sim.bench.verify import verify
from sim.cli.command_line import main
from sim.errors import UsageError
from sim.plugs.errors import PlugError

ROOT = Path(__file__).resolve().parents[3]
SLOW_PLANNER = """
import time
from planner import Planner

class Slow(Planner):
    needs_belief = False
    def rank(self, situation):
        time.sleep(0.4)
        n = situation.workspace.n_poses
        yield (len(situation.sensed) * 997) % n
class Broken(Planner):
    needs_belief = False
    def rank(self, situation):
        raise RuntimeError("no idea")
"""
RUN = """
import sys
from pathlib import Path
from sim.bench.run import BenchSettings, run_bench
from sim.bench.tasks import load_task
run_bench("slow_planner:Slow", [load_task(Path(sys.argv[1]))], Path(sys.argv[2]), BenchSettings(n_jobs=1))
"""


@pytest.fixture
def own_planner(tmp_path, monkeypatch) -> Path:
    """A module of planners in the current folder."""
    (tmp_path / "slow_planner.py").write_text(SLOW_PLANNER)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    sys.modules.pop("slow_planner", None)


def content_of(out: Path) -> dict:
    content = json.loads((out / "submission" / "submission.json").read_text())
    content.pop("trial_s")
    return content


def test_a_killed_run_goes_on_and_writes_the_same(own_planner, toys, here) -> None:
    task = toys[0].scenario.parent.parent / "tasks" / "toy-v1.toml"
    out = own_planner / "killed"
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{own_planner}"}
    command = [sys.executable, "-c", RUN, str(task), str(out)]
    process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL, start_new_session=True)
    journal = out / "campaigns" / "toy-v1" / "journal.jsonl"
    deadline = time.monotonic() + 120
    while not (journal.is_file() and journal.read_bytes().count(b"\n")) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    n_before = journal.read_bytes().count(b"\n")
    assert 1 <= n_before <= 3
    assert not (out / "submission").exists()
    first = journal.read_bytes().split(b"\n")[0]
    run_bench("slow_planner:Slow", toys[:1], out, BenchSettings())
    assert journal.read_bytes().split(b"\n")[0] == first
    run_bench("slow_planner:Slow", toys[:1], own_planner / "whole", BenchSettings())
    assert content_of(out) == content_of(own_planner / "whole")
    assert (out / "submission" / "slow_planner.py").read_text() == SLOW_PLANNER


def test_a_quick_run_grows_to_a_full_one(toys, submission, here, tmp_path) -> None:
    run_bench("random", toys[:1], tmp_path / "out", BenchSettings(quick=True))
    full = run_bench("random", toys[:1], tmp_path / "out", BenchSettings())
    assert full is not None
    trials = full["tasks"]["toy-v1"]["trials"]
    assert len(trials) == 3
    assert trials[:2] == content_of(submission)["tasks"]["toy-v1"]["trials"]


def test_the_folder_of_another_planner_is_left_alone(submission, toys, tmp_path) -> None:
    with pytest.raises(UsageError, match="was begun with another planner"):
        run_bench("greedy-coverage", toys, submission, BenchSettings(quick=True))
    with pytest.raises(UsageError, match="was begun with another key"):
        run_bench("random", toys, submission, BenchSettings(quick=True, key=b"k" * 32))
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(UsageError, match="this command wrote none of it"):
        run_bench("random", toys, tmp_path, BenchSettings())


def test_a_planner_that_raises_has_the_worst_score(own_planner, toys, here) -> None:
    content = run_bench("slow_planner:Broken", toys, own_planner / "out", BenchSettings(quick=True))
    assert content is not None
    parts = content["tasks"]
    assert [parts[task.name]["n_failed"] for task in toys] == [2, 2]
    assert [parts[task.name]["mean"] for task in toys] == [3.0, 0.0]
    assert "no idea" in parts["toy-v1"]["trials"][0]["error"]
    verdict = verify(own_planner / "out", tasks=toys)
    assert (verdict.faults, verdict.n_trials, verdict.n_failed) == ((), 0, 4)


def test_a_planner_that_is_edited_meanwhile_is_no_submission(own_planner, toys, here, monkeypatch) -> None:
    file, trials = own_planner / "slow_planner.py", run.run_trials

    def run_and_edit(*args, **options):
        file.write_text(SLOW_PLANNER + "# edited\n")
        return trials(*args, **options)

    with monkeypatch.context() as patch:
        patch.setattr(run, "run_trials", run_and_edit)
        with pytest.raises(UsageError, match=r"slow_planner.py: was changed while the benchmark ran"):
            run_bench("slow_planner:Broken", toys[:1], own_planner / "out", BenchSettings(quick=True))
    assert not (own_planner / "out" / "submission").exists()
    campaigns = own_planner / "out" / "campaigns"
    assert [folder.name for folder in campaigns.iterdir()] == [f"{toys[0].name}-set-aside-1"]
    file.write_text(SLOW_PLANNER)
    assert run_bench("slow_planner:Broken", toys[:1], own_planner / "out", BenchSettings(quick=True))


def test_a_tumour_that_was_never_sensed_counts_as_the_most_actions(toys) -> None:
    never = {"status": "finished", "results": {"sensings_to_95": None}}
    there = {"status": "finished", "results": {"sensings_to_95": 2}}
    assert trial_scores(toys[0], [never, there]) == [3.0, 2.0]


def test_mistakes_are_told_in_one_line(capsys, tmp_path) -> None:
    assert main(["bench", "--planner", "find-and-outlin", "--out", str(tmp_path / "x")]) == 2
    assert "Did you mean find-and-outline?" in capsys.readouterr().err
    assert main(["bench", "--planner", "random", "--out", str(tmp_path / "x"), "--task", "liver"]) == 2
    assert "Did you mean liver-v1?" in capsys.readouterr().err
    assert main(["bench"]) == 2
    assert "give --planner and --out" in capsys.readouterr().err
    with pytest.raises(PlugError):
        run_bench("no_such_module:Planner", (), tmp_path / "x", BenchSettings())


def test_the_tasks_are_listed(capsys) -> None:
    assert main(["bench", "--list"]) == 0
    out = capsys.readouterr().out
    assert out.count("actions; ") == len(all_tasks())
    assert "sphere-v1" in out

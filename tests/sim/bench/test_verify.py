"""A submission that holds is verified, and one that was tampered with is told where."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace

import pytest

from sim.bench.run import BenchSettings, run_bench
from sim.bench.verify import verify
from sim.cli.command_line import main
from sim.errors import UsageError

pytestmark = pytest.mark.usefixtures("here")


@pytest.fixture
def tampered(submission, tmp_path):
    """Writes a submission that a function has changed, and returns its folder."""

    def write(change):
        content = json.loads((submission / "submission" / "submission.json").read_text())
        change(content)
        (tmp_path / "submission.json").write_text(json.dumps(content))
        return tmp_path

    return write


def trial(content, task="toy-map-v1", index=1):
    return content["tasks"][task]["trials"][index]


@pytest.mark.parametrize("rerun", [False, True])
def test_what_was_not_touched_holds(submission, toys, rerun) -> None:
    verdict = verify(submission, tasks=toys, rerun=rerun)
    assert (verdict.faults, verdict.n_trials) == ((), 4)


def test_a_score_that_does_not_follow_is_found(tampered, toys) -> None:
    path = tampered(lambda content: content["tasks"]["toy-map-v1"].update(mean=0.99))
    (fault,) = verify(path, tasks=toys).faults
    assert "the score does not follow from the trials" in fault


def test_a_result_that_the_poses_do_not_give_is_found(tampered, toys) -> None:
    def change(content) -> None:
        part = content["tasks"]["toy-map-v1"]
        trial(content)["results"]["n_false_findings"] = 17
        assert part["score"] == "auprc"

    (fault,) = verify(tampered(change), tasks=toys).faults
    assert fault.startswith("toy-map-v1, trial 1: n_false_findings is 17 there and ")


@pytest.mark.parametrize(("by", "holds"), [(3e-5, True), (-3e-3, False)])
def test_last_digits_of_another_processor_hold_and_are_told(tampered, toys, by, holds) -> None:
    def change(content) -> None:
        results = trial(content, task="toy-v1")["results"]
        results["sensed_fraction"] += by

    verdict = verify(tampered(change), tasks=toys)
    assert verdict.n_near == holds
    assert (verdict.faults == ()) is holds


def test_other_poses_are_found(tampered, toys) -> None:
    path = tampered(lambda content: trial(content).update(poses=[5, 300, 600]))
    (fault,) = verify(path, tasks=toys).faults
    assert fault.startswith("toy-map-v1, trial 1: ")
    assert "auprc" in fault


def test_a_pose_that_does_not_exist_is_found(tampered, toys) -> None:
    path = tampered(lambda content: trial(content)["poses"].__setitem__(0, 10**6))
    (fault,) = verify(path, tasks=toys).faults
    assert "status is finished there and failed here" in fault


def test_poses_of_another_planner_are_found_by_running_it_again(tampered, toys, submission, tmp_path) -> None:
    other = tmp_path / "other"
    run_bench("multi-resolution", toys, other, BenchSettings(quick=True))
    content = json.loads((other / "submission" / "submission.json").read_text())
    mine = json.loads((submission / "submission" / "submission.json").read_text())
    path = tampered(lambda changed: changed.update(tasks=content["tasks"]))
    assert content["planner"]["map"] == mine["planner"]["map"]
    assert verify(path, tasks=toys).faults == ()
    assert any("pose 1 is" in fault for fault in verify(path, tasks=toys, rerun=True).faults)


def test_a_changed_task_is_told(submission, toys) -> None:
    changed = (replace(toys[0], digest="f" * 64), toys[1])
    (fault,) = verify(submission, tasks=changed).faults
    assert fault.startswith("toy-v1: its files have the digest")
    assert verify(submission, tasks=toys[1:]).faults == ("toy-v1: there is no such task in this version",)


def test_a_score_or_direction_that_is_not_the_tasks_is_told(tampered, toys) -> None:
    for change in ({"score": "no_such_score"}, {"direction": "lower"}):
        path = tampered(lambda content, change=change: content["tasks"]["toy-map-v1"].update(change))
        (fault,) = verify(path, tasks=toys).faults
        (name,) = change
        assert fault.startswith(f"toy-map-v1: its {name} is {change[name]} there and ")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"tasks": {}}, "holds no task"),
        ({"versions": []}, "`versions` is [], and has to be an object"),
        ({"planner": "x"}, '`planner` is "x", and has to be an object'),
        ({"tasks": []}, "`tasks` is [], and has to be an object"),
        ({"planner": {"map": "paper"}}, "the planner's text is None"),
    ],
)
def test_a_submission_that_says_nothing_or_is_malformed_does_not_hold(tampered, change, text, capsys) -> None:
    path = tampered(lambda content: content.update(change))
    assert main(["bench", "--verify", str(path)]) == 1
    assert text in capsys.readouterr().out


def test_a_copy_of_the_planner_that_is_another_or_missing_is_told(tampered, toys) -> None:
    source = b"raise SystemExit('the check runs nobody's code')"

    def change(content) -> None:
        digest = hashlib.sha256(source).hexdigest()
        content["planner"].update(text="mine:Mine", source="mine.py", source_sha256=digest)

    path = tampered(change)
    assert verify(path, tasks=toys).faults == (
        "mine.py, the copy of the planner's file, is not beside submission.json",
    )
    (path / "mine.py").write_bytes(source)
    assert verify(path, tasks=toys).faults == ()
    (path / "mine.py").write_bytes(source + b" ")
    (fault,) = verify(path, tasks=toys).faults
    assert fault.startswith("mine.py, the copy of the planner's file, has the digest ")
    path = tampered(lambda content: content["planner"].update(source="../mine.py"))
    assert "is no plain name of a file" in verify(path, tasks=toys).faults[0]


def test_other_versions_are_told(tampered, toys) -> None:
    path = tampered(lambda content: content["versions"].update(numpy="1.0"))
    (fault,) = verify(path, tasks=toys).faults
    assert fault.startswith("made with numpy 1.0, and here is ")


def test_left_out_and_reordered_trials_are_told(tampered, toys) -> None:
    path = tampered(lambda content: content["tasks"]["toy-v1"]["trials"].pop())
    assert "the tier has 2 trials" in verify(path, tasks=toys).faults[0]
    path = tampered(lambda content: trial(content).update(seed=7002))
    assert "other seeds" in verify(path, tasks=toys).faults[0]


def test_what_is_no_submission_is_told_in_one_line(tmp_path, submission, tampered, capsys) -> None:
    with pytest.raises(UsageError, match="holds no submission"):
        verify(tmp_path)
    assert main(["bench", "--verify", str(submission)]) == 1
    assert "does not hold: toy-v1: there is no such task" in capsys.readouterr().out
    path = tampered(lambda content: content["tasks"]["toy-v1"].pop("digest"))
    assert main(["bench", "--verify", str(path)]) == 1
    shutil.copy(path / "submission.json", tmp_path / "broken.json")
    (tmp_path / "submission.json").write_text("{")
    assert main(["bench", "--verify", str(tmp_path)]) == 2

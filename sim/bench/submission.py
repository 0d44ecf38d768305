"""The submission: submission.json with every trial, and the planner's file where it is one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mapping.storage import replacing
from sim.errors import UsageError
from sim.record.run_folder import describe_machine

from .entrant import Entrant
from .results import Record, task_score
from .tasks import SCORES, Task

FORMAT = 1
SUBMISSION = "submission.json"
PACKAGES = ("numpy", "scipy", "mujoco")
"""Packages of whose versions the results are."""


@dataclass(frozen=True, kw_only=True)
class TaskRun:
    """The trials of a task."""

    task: Task
    records: Sequence[Record]
    trial_s: float
    """Seconds of all trials, one after the other."""


def versions() -> dict[str, str | None]:
    """The versions on which results depend."""
    machine = describe_machine()
    return {"sounding": machine["sounding"], **{name: machine["packages"][name] for name in PACKAGES}}


def write_submission(
    folder: Path, entrant: Entrant, runs: Sequence[TaskRun], *, tier: str, committed: str | None
) -> dict[str, Any]:
    """Write the submission of an entrant, and return what submission.json says.

    Args:
        folder: The folder to hand in.
        entrant: The planner.
        runs: The trials of each task.
        tier: `full` or `quick`.
        committed: The commitment to the key of hidden seeds; None for public ones.

    Raises:
        UsageError: The planner's source is no longer what it was when the run began.
    """
    source = entrant.source_bytes()
    folder.mkdir(exist_ok=True)
    machine = describe_machine()
    content = {
        "format": FORMAT,
        "benchmark": "Sounding-Bench",
        "tier": tier,
        "planner": {
            "text": entrant.text,
            "map": entrant.map_settings,
            "source_sha256": entrant.source_sha256,
            "source": entrant.source.name if entrant.source is not None else None,
        },
        "key": committed,
        "versions": versions(),
        "machine": {name: machine[name] for name in ("commit", "python", "platform")},
        "trial_s": round(sum(run.trial_s for run in runs), 1),
        "tasks": {run.task.name: task_part(run.task, run.records) for run in runs},
    }
    if entrant.source is not None and source is not None:
        (folder / entrant.source.name).write_bytes(source)
    with replacing(folder / SUBMISSION) as file:
        file.write(_lines(content).encode())
    return content


def task_part(task: Task, records: Sequence[Record]) -> dict[str, Any]:
    """What a submission says of a task."""
    return {
        "digest": task.digest,
        "score": task.score,
        "direction": task.direction,
        **task_score(task, records),
        "trials": list(records),
    }


def submission_folder(path: Path) -> Path:
    """The folder that holds submission.json: one of a run of the benchmark holds it in a folder of its own."""
    inner = path / "submission"
    return inner if (inner / SUBMISSION).is_file() else path


def read_submission(path: Path) -> dict[str, Any]:
    """What the submission.json of a folder says, which may be that of a run of the benchmark.

    Raises:
        UsageError: There is none, or it cannot be used.
    """
    file = submission_folder(path) / SUBMISSION
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise UsageError(
            f"{path}: holds no submission. Name a folder that `sounding bench` has finished."
        ) from error
    except (OSError, ValueError) as error:
        raise UsageError(f"{file}: cannot be read ({error}).") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UsageError(f"{file}: is no submission of a version that this one reads (format {FORMAT}).")
    return content


def submission_text(content: Mapping[str, Any]) -> str:
    """A submission as a table for the terminal."""
    width = max(len(name) for name in content["tasks"])
    lines = []
    for name, part in content["tasks"].items():
        failed = f", {part['n_failed']} failed" if part["n_failed"] else ""
        better = "fewer is better" if part["direction"] == "lower" else "more is better"
        shown = f"{score_text(part):<24} {part['n']:>3} trials{failed}"
        lines.append(f"{name:<{width}}  {shown}  {SCORES[part['score']]} ({better})")
    return "\n".join(lines)


def score_text(part: Mapping[str, Any]) -> str:
    """The score of a task with its interval."""
    form = "{:.2f}" if part["direction"] == "lower" else "{:.3f}"
    ends = part["interval"]
    interval = "" if None in ends else f" [{form.format(ends[0])}, {form.format(ends[1])}]"
    return form.format(part["mean"]) + interval


def _lines(content: Mapping[str, Any]) -> str:
    """A submission as JSON with a line for each trial, so that a difference of two shows which trial it is in."""
    marks: dict[str, str] = {}

    def mark(record: Record) -> str:
        name = f"trial {len(marks)} of the submission"
        marks[json.dumps(name)] = json.dumps(record, allow_nan=False)
        return name

    tasks = {
        name: part | {"trials": [mark(record) for record in part["trials"]]}
        for name, part in content["tasks"].items()
    }
    text = json.dumps({**content, "tasks": tasks}, indent=2, allow_nan=False)
    lines = text.splitlines()
    for index, line in enumerate(lines):
        word = line.strip().removesuffix(",")
        if word in marks:
            lines[index] = line.replace(word, marks[word])
    return "\n".join(lines) + "\n"

"""The check of a submission: its trials are run again, and what they give is held against what it says."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.campaign.campaign import run_trials
from sim.errors import FieldError

from .claims import faults_of_claims
from .entrant import load_entrant
from .hidden_seeds import commitment
from .results import Record, trial_records
from .studies import planner_study, replay_study, seeds_of
from .submission import read_submission, submission_folder
from .tasks import Task, all_tasks

MOST_TOLD = 5
"""Trials of a task that are told one by one."""
TOLERANCE = 1e-4
"""Results that are no counts may differ by so much: processors differ in the last digits, and a map's carry over."""


@dataclass(frozen=True)
class Verdict:
    """What the check of a submission found."""

    faults: tuple[str, ...]
    """What does not hold, a sentence each; none where all holds."""
    n_trials: int
    """Trials that were run again."""
    n_near: int = 0
    """How many of them gave results that are the same within the tolerance, but not to the last digit."""
    is_interrupted: bool = False
    n_failed: int = 0
    """Trials that failed in the submission; without the planner there is nothing to run again."""


def verify(
    path: Path,
    *,
    rerun: bool = False,
    key: bytes | None = None,
    n_jobs: int = 2,
    tasks: Sequence[Task] | None = None,
) -> Verdict:
    """Check a submission without trust in what it says.

    Args:
        path: Its folder.
        rerun: Whether the planner chooses the poses again; by default the probe goes to those recorded.
        key: The key of its hidden seeds; None for public ones.
        n_jobs: Number of processes.
        tasks: The tasks; by default those that Sounding brings along.

    Raises:
        UsageError: There is no submission, or its key is missing or another.
    """
    content = read_submission(path)
    _check_key(content, key)
    known = {task.name: task for task in (all_tasks() if tasks is None else tasks)}
    faults = faults_of_claims(content, known, key, submission_folder(path))
    if rerun and not faults:
        faults += _faults_of_source(content)
    if faults:
        # Without the same tasks, seeds and trials there is nothing to compare.
        return Verdict(tuple(faults), 0)
    n_trials = n_near = 0
    with tempfile.TemporaryDirectory(prefix="sounding-bench-") as folder:
        for name, part in content["tasks"].items():
            found = _run_again(content, known[name], Path(folder) / name, rerun=rerun, key=key, n_jobs=n_jobs)
            if found is None:
                return Verdict(tuple(faults), n_trials, n_near, is_interrupted=True)
            told = [each for each in part["trials"] if rerun or each["status"] == "finished"]
            faults += differences(name, told, found)
            n_trials += len(found)
            n_near += sum(
                _text(one) != _text(two) and _is_same(one, two) for one, two in zip(told, found, strict=True)
            )
    return Verdict(tuple(faults), n_trials, n_near, n_failed=_n_failed(content))


def _n_failed(content: Mapping[str, Any]) -> int:
    trials = [each for part in content["tasks"].values() for each in part["trials"]]
    return sum(each["status"] != "finished" for each in trials)


def _check_key(content: Mapping[str, Any], key: bytes | None) -> None:
    held = None if key is None else commitment(key)
    if content.get("key") == held:
        return
    if key is None:
        raise FieldError("key", None, "the submission has hidden seeds. Give the organiser's key.")
    whose = "public seeds: leave `key` out" if content.get("key") is None else "the seeds of another key"
    raise FieldError("key", "given", f"the submission has {whose}.")


def _faults_of_source(content: Mapping[str, Any]) -> list[str]:
    told = content["planner"]
    entrant = load_entrant(told["text"])
    if entrant.source_sha256 == told["source_sha256"] and entrant.map_settings == told["map"]:
        return []
    return [f"the planner {told['text']} found here has another source than the submission's"]


def _run_again(
    content: Mapping[str, Any], task: Task, folder: Path, *, rerun: bool, key: bytes | None, n_jobs: int
) -> list[Record] | None:
    """The trials of a task, run again; None where that was interrupted."""
    records, planner = content["tasks"][task.name]["trials"], content["planner"]
    seeds = seeds_of(task, quick=content["tier"] == "quick", key=key)
    if not rerun:
        # What failed has no end to compare; it counts as the worst anyway.
        chosen = [i for i, record in enumerate(records) if record["status"] == "finished"]
        seeds, records = tuple(seeds[i] for i in chosen), [records[i] for i in chosen]
        if not chosen:
            return []
        study = replay_study(task, planner["map"], seeds, records)
    else:
        study = planner_study(task, planner["text"], planner["map"], seeds)
    if run_trials(study, folder, jobs=n_jobs).is_interrupted:
        return None
    found = trial_records(task, folder, seeds, is_hidden=key is not None)
    return [again | {"index": record["index"]} for again, record in zip(found, records, strict=True)]


def differences(task: str, told: Sequence[Record], found: Sequence[Record]) -> list[str]:
    """Where the trials of a task differ from what was recorded: in anything, or in a result by more than `TOLERANCE`.

    Args:
        task: The task's name.
        told: The records of the submission.
        found: The same trials, run again.
    """
    faults = []
    for one, other in zip(told, found, strict=True):
        names = dict.fromkeys((*one, *other))
        wrong = [name for name in names if not _is_same(one.get(name), other.get(name))]
        if wrong:
            faults.append(
                f"{task}, trial {one['index']}: {'; '.join(_differs(n, one, other) for n in wrong)}"
            )
    if len(faults) > MOST_TOLD:
        faults = [*faults[:MOST_TOLD], f"{task}: {len(faults) - MOST_TOLD} more trials differ"]
    return faults


def _differs(name: str, told: Record, found: Record) -> str:
    if name == "results" and isinstance(told.get(name), dict) and isinstance(found.get(name), dict):
        one, other = told[name], found[name]
        keys = [key for key in dict.fromkeys((*one, *other)) if not _is_same(one.get(key), other.get(key))]
        return "; ".join(f"{key} is {one.get(key)} there and {other.get(key)} here" for key in keys)
    if name == "poses":
        pairs = enumerate(zip(told["poses"], found["poses"], strict=False), 1)
        first = next((number for number, (a, b) in pairs if a != b), None)
        if first is None:
            return f"{len(told['poses'])} poses there and {len(found['poses'])} here"
        return f"pose {first} is {told['poses'][first - 1]} there and {found['poses'][first - 1]} here"
    return f"{name} is {told.get(name)} there and {found.get(name)} here"


def _is_same(one: Any, other: Any) -> bool:
    """Whether two plain values are the same, numbers that are no counts within the tolerance."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_is_same(one[key], other[key]) for key in one)
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) <= TOLERANCE
    return _text(one) == _text(other)


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)

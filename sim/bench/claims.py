"""What a submission claims, held against the tasks and against itself, before anything is run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .results import task_score
from .studies import seeds_of
from .submission import versions
from .tasks import Task

PARTS = ("tier", "planner", "versions", "tasks")
TABLES = PARTS[1:]
"""Parts that hold values by name."""


def faults_of_claims(
    content: Mapping[str, Any], known: Mapping[str, Task], key: bytes | None, folder: Path
) -> list[str]:
    """What does not hold in a submission: versions, planner, tasks, seeds, and scores that its trials do not give.

    Args:
        content: What submission.json says.
        known: The tasks by name.
        key: The key of hidden seeds; None for public ones.
        folder: The folder that holds submission.json, and the copy of the planner's file.
    """
    missing = [name for name in PARTS if name not in content]
    if missing:
        return [f"the submission lacks {', '.join(missing)}"]
    faults = [
        f"`{name}` is {json.dumps(content[name])[:60]}, and has to be an object with values by name"
        for name in TABLES
        if not isinstance(content[name], dict)
    ]
    if faults:
        return faults
    if content["tier"] not in ("quick", "full"):
        return [f"the tier {content['tier']} is none of quick and full"]
    if not content["tasks"]:
        return ["the submission holds no task, so that there is nothing to verify"]
    faults = [
        f"made with {name} {content['versions'].get(name)}, and here is {present}"
        for name, present in versions().items()
        if content["versions"].get(name) != present
    ]
    faults += _faults_of_planner(content["planner"], folder)
    for name, part in content["tasks"].items():
        try:
            faults += [f"{name}: {fault}" for fault in _faults_of_task(part, known.get(name), content, key)]
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            faults.append(f"{name}: is not as `sounding bench` writes it ({type(error).__name__}: {error})")
    return faults


def _faults_of_planner(planner: Mapping[str, Any], folder: Path) -> list[str]:
    """What does not hold of the planner, whose copy is read and not run."""
    faults = [
        f"the planner's {name} is {planner.get(name)}, and has to be a text"
        for name in ("text", "source_sha256")
        if not isinstance(planner.get(name), str)
    ]
    if planner.get("map") not in ("paper", "calibrated"):
        faults.append(f"the map {planner.get('map')} is none of paper and calibrated")
    source = planner.get("source")
    if faults or source is None:  # a built-in planner, or one of a package, has no copy
        return faults
    if not isinstance(source, str) or Path(source).name != source or "\\" in source or "\0" in source:
        return [f"the planner's source {source} is no plain name of a file beside submission.json"]
    if not (folder / source).is_file():
        return [f"{source}, the copy of the planner's file, is not beside submission.json"]
    found = hashlib.sha256((folder / source).read_bytes()).hexdigest()
    if found == planner["source_sha256"]:
        return []
    told = planner["source_sha256"][:12]
    return [f"{source}, the copy of the planner's file, has the digest {found[:12]}, and {told} is told"]


def _faults_of_task(
    part: Mapping[str, Any], task: Task | None, content: Mapping[str, Any], key: bytes | None
) -> list[str]:
    if task is None:
        return ["there is no such task in this version"]
    if part["digest"] != task.digest:
        return [f"its files have the digest {part['digest'][:12]} there and {task.digest[:12]} here"]
    for name, present in (("score", task.score), ("direction", task.direction)):
        if part[name] != present:
            return [f"its {name} is {part[name]} there and {present} here"]
    seeds = seeds_of(task, quick=content["tier"] == "quick", key=key)
    trials = part["trials"]
    if [record["index"] for record in trials] != list(range(len(seeds))):
        return [f"the tier has {len(seeds)} trials, and the submission's are others"]
    if key is None and [record["seed"] for record in trials] != list(seeds):
        return ["its trials have other seeds than the task's"]
    faults = [
        f"trial {record['index']}: its poses are no whole numbers"
        for record in trials
        if not all(type(pose) is int for pose in record["poses"])
    ]
    claimed = {name: part[name] for name in ("mean", "interval", "n", "n_failed")}
    found = task_score(task, trials)
    if json.dumps(claimed) != json.dumps(found):
        faults.append(f"the score does not follow from the trials: {claimed} there and {found} here")
    return faults

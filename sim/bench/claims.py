"""What a submission claims, held against the tasks and against itself, before anything is run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from .results import task_score
from .studies import seeds_of
from .submission import versions
from .tasks import Task

PARTS = ("tier", "planner", "versions", "tasks")


def faults_of_claims(content: Mapping[str, Any], known: Mapping[str, Task], key: bytes | None) -> list[str]:
    """What does not hold in a submission: versions, tasks, seeds, and scores that do not follow from its trials.

    Args:
        content: What submission.json says.
        known: The tasks by name.
        key: The key of hidden seeds; None for public ones.
    """
    missing = [name for name in PARTS if name not in content]
    if missing:
        return [f"the submission lacks {', '.join(missing)}"]
    if content["tier"] not in ("quick", "full"):
        return [f"the tier {content['tier']} is none of quick and full"]
    faults = [
        f"made with {name} {content['versions'].get(name)}, and here is {present}"
        for name, present in versions().items()
        if content["versions"].get(name) != present
    ]
    if content["planner"].get("map") not in ("paper", "calibrated"):
        faults.append(f"the map {content['planner'].get('map')} is none of paper and calibrated")
    for name, part in content["tasks"].items():
        try:
            faults += [f"{name}: {fault}" for fault in _faults_of_task(part, known.get(name), content, key)]
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            faults.append(f"{name}: is not as `sounding bench` writes it ({type(error).__name__}: {error})")
    return faults


def _faults_of_task(
    part: Mapping[str, Any], task: Task | None, content: Mapping[str, Any], key: bytes | None
) -> list[str]:
    if task is None:
        return ["there is no such task in this version"]
    if part["digest"] != task.digest:
        return [f"its files have the digest {part['digest'][:12]} there and {task.digest[:12]} here"]
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

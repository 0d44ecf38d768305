"""The trials of a task as a submission holds them, and the score that follows from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim.campaign.campaign_folder import JOURNAL
from sim.campaign.journal import read_entries
from sim.comparison.estimates import mean_estimate

from .tasks import SENSINGS, Task

Record = dict[str, Any]


def trial_records(task: Task, folder: Path, seeds: Sequence[int], *, is_hidden: bool) -> list[Record]:
    """The trials of a task's campaign as plain data, in the order of their seeds; hidden seeds are left out.

    Args:
        task: The task.
        folder: The campaign's folder, which holds a trial of every seed.
        seeds: The seeds of the trials.
        is_hidden: Whether the seeds are hidden.
    """
    entries = {entry["settings"]["seed"]: entry for entry in read_entries(folder / JOURNAL)}
    records = []
    for index, seed in enumerate(seeds):
        row, poses = entries[seed]["row"], entries[seed].get("poses", [])
        record: Record = {"index": index} | ({} if is_hidden else {"seed": seed})
        record |= {"status": row["status"], "poses": poses}
        if row["status"] == "finished":
            record["results"] = {name: row.get(name) for name in task.measures}
        else:
            record["error"] = row.get("error")
        records.append(record)
    return records


def trial_seconds(folder: Path) -> float:
    """The seconds that all trials of a campaign took, one after the other."""
    return sum(float(entry["timings"].get("wall_s", 0.0)) for entry in read_entries(folder / JOURNAL))


def trial_scores(task: Task, records: Sequence[Record]) -> list[float]:
    """The score of each trial; one that failed has the worst, and one with nothing to find is left out."""
    scores = []
    for record in records:
        if record["status"] != "finished":
            scores.append(task.worst)
            continue
        value = record["results"][task.score]
        if value is not None:
            scores.append(float(value))
        elif task.score == SENSINGS:
            scores.append(float(task.steps))  # never there: counts as the most actions
    return scores


def task_score(task: Task, records: Sequence[Record]) -> dict[str, Any]:
    """The mean of a task's scores with its 95 % interval, None where too few trials give one."""
    estimate = mean_estimate(trial_scores(task, records))
    return {
        "mean": estimate.mean,
        "interval": [None if math.isnan(end) else float(end) for end in estimate.interval],
        "n": estimate.n,
        "n_failed": sum(record["status"] != "finished" for record in records),
    }

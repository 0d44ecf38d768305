"""The program behind `sounding bench`: it runs a planner on the tasks, and writes the submission."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.campaign.campaign import run_trials
from sim.notices import Notify, print_notice

from .bench_folder import BenchFolder
from .entrant import load_entrant
from .hidden_seeds import commitment
from .results import trial_records, trial_seconds
from .studies import planner_study, seeds_of
from .submission import TaskRun, write_submission
from .tasks import Task


@dataclass(frozen=True, kw_only=True)
class BenchSettings:
    """How the benchmark is run."""

    quick: bool = False
    """Whether only the first seeds of each task are run."""
    n_jobs: int = 2
    """Number of processes; what is written does not depend on it, but for the seconds."""
    key: bytes | None = None
    """The key of hidden seeds; None for the public ones."""


def run_bench(
    planner: str,
    tasks: Sequence[Task],
    out: Path,
    settings: BenchSettings,
    *,
    notify: Notify = print_notice,
) -> dict[str, Any] | None:
    """Run what the folder does not hold yet, and return the submission; None where it was interrupted.

    Args:
        planner: A planner's name, or `module:Class`.
        tasks: The tasks.
        out: The folder of the run.
        settings: How it is run.
        notify: Tells a notice.

    Raises:
        UsageError, PlugError: Something cannot be done; what the folder held is kept.
        OSError: The disk is full, for example; what was done is kept.
    """
    entrant = load_entrant(planner)
    committed = None if settings.key is None else commitment(settings.key)
    with BenchFolder(out) as folder:
        folder.begin(entrant, committed)
        runs = []
        for number, task in enumerate(tasks, 1):
            seeds = seeds_of(task, quick=settings.quick, key=settings.key)
            study = planner_study(task, entrant.text, entrant.map_settings, seeds)
            print(f"task {number} of {len(tasks)}", file=sys.stderr)
            campaign = folder.campaign(task.name)
            done = run_trials(study, campaign, jobs=settings.n_jobs, retry_failed=True, notify=notify)
            with folder.set_aside_on_error(task.name):
                entrant.source_bytes()
            if done.is_interrupted:
                return None
            records = trial_records(task, campaign, seeds, is_hidden=committed is not None)
            runs.append(TaskRun(task=task, records=records, trial_s=trial_seconds(campaign)))
        tier = "quick" if settings.quick else "full"
        return write_submission(folder.submission, entrant, runs, tier=tier, committed=committed)

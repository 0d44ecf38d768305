"""How fast trials run, and what takes their time: `.venv/bin/python -m benchmarks.trials`.

It runs trials of the paper's scenario 1 in this process, which is one core, and then a campaign with 1 and 2 processes.
CPU time says what a quiet machine would take, and wall time what this machine took.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time

import tyro

from sim.campaign.campaign import run_trials
from sim.campaign.study import Trial, make_study
from sim.campaign.trial import run_trial
from sim.running.fields import config_of
from sim.tables import markdown_table

PARTS = ("setup_s", "plan_s", "ik_s", "move_s", "sense_s", "update_s", "findings_s")
ROWS = (
    ("expected-improvement", "none", "none"),
    ("random", "none", "none"),
    ("multi-resolution", "none", "none"),
    ("expected-improvement", "default", "none"),
    ("expected-improvement", "default", "kinematic"),
    ("random", "default", "none"),
    ("random", "default", "kinematic"),
    ("multi-resolution", "default", "none"),
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Measure trials of scenario 1 until 95 % is sensed."""

    trials: int = 10
    """Number of seeds of each row; an arm is built anew for each row, with no pose solved before."""
    jobs: bool = True
    """Measure campaigns with 1 and 2 processes as well."""


def measure(planner: str, arm: str, motion: str, n_trials: int) -> list[str]:
    """A row: actions per second of CPU and of wall time, and the share of each part."""
    config = config_of(
        scenario="sphere",
        planner=planner,
        arm=arm,
        motion=motion,
        steps=2000,
        until_sensed=0.95,
        map="when-needed",
    )
    # The first trial drops the setup of the row before, and the second builds that of this row.
    run_trial(Trial(replace(config, scenario="spheres", steps=1)))
    run_trial(Trial(replace(config, steps=1, seed=10_000)))
    n_actions, parts, memory_mb = 0, dict.fromkeys(PARTS, 0.0), 0.0
    cpu_start_s, wall_start_s = process_time(), perf_counter()
    for seed in range(n_trials):
        result = run_trial(Trial(replace(config, seed=seed)))
        n_actions += result.row["n_sensings"]
        memory_mb = result.timings["peak_memory_mb"]
        for part in PARTS:
            parts[part] += result.timings[part]
    cpu_s, wall_s = process_time() - cpu_start_s, perf_counter() - wall_start_s
    shares = [f"{parts[part] / wall_s:.0%}" for part in PARTS]
    speeds = [f"{n_actions / cpu_s:.1f}", f"{n_actions / wall_s:.1f}"]
    return [planner, arm, motion, str(n_actions), *speeds, *shares, f"{memory_mb:.0f}"]


def measure_jobs(n_jobs: int, folder: Path, n_trials: int = 60) -> float:
    """The trials per second of a campaign, with the start of its processes included."""
    study = make_study(
        scenario="sphere",
        planner="expected-improvement",
        arm="none",
        motion="none",
        steps=10,
        seed=f"0:{n_trials}",
    )
    start_s = perf_counter()
    run_trials(study, folder / str(n_jobs), jobs=n_jobs)
    return n_trials / (perf_counter() - start_s)


def main(options: Options) -> None:
    """Measure and print."""
    head = ("planner", "arm", "motion", "actions", "actions/CPU s", "actions/s", *PARTS, "MB")
    print(markdown_table(head, [measure(*row, options.trials) for row in ROWS]))
    if options.jobs:
        with tempfile.TemporaryDirectory() as folder:
            one, two = (measure_jobs(n_jobs, Path(folder)) for n_jobs in (1, 2))
        print(f"trials/s with 1 process {one:.2f}, with 2 {two:.2f}: {two / one:.2f} times")


if __name__ == "__main__":
    main(tyro.cli(Options))

"""`sounding bench`: a planner on the frozen tasks of Sounding-Bench, its submission, and the check of one."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sim.cli.terminal import INTERRUPTED, NOT_USABLE, note, parse
from sim.errors import FieldError, UsageError

EXAMPLES = """
sounding bench --list
sounding bench --planner my_planner:MyPlanner --out renders/bench --quick
sounding bench --planner my_planner:MyPlanner --out renders/bench      # all seeds; again after a kill: it goes on
sounding bench --verify renders/bench                      # replays the recorded poses
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run a planner on the frozen tasks of the benchmark, and write a submission that anybody can check.

    The output folder gets a campaign for each task, and the folder submission to hand in. Called again, also after a
    kill, the command goes on where it stopped. docs/bench.md tells the rules.
    """

    list: bool = False
    """Show the tasks, and run nothing."""
    planner: str | None = None
    """The planner that enters: a built-in one's name, or your own as package.module:Class."""
    task: tuple[str, ...] = ()
    """Tasks to run, for example sphere-v1; by default all, which a submission to the leaderboard needs."""
    quick: bool = False
    """Run the first seeds of each task alone, which takes a tenth of the time."""
    out: Path | None = None
    """Folder to write to."""
    verify: Path | None = None
    """Check the submission in this folder: go to its recorded poses, and compare every result."""
    rerun: bool = False
    """With `verify`, let the planner choose the poses again, which proves that they are its own."""
    key: Path | None = None
    """File of the organiser's key, of at least 32 random bytes, from which hidden seeds are made."""
    jobs: int = 2
    """Number of processes; the results do not depend on it."""

    def __post_init__(self) -> None:
        """Validate the ranges, and what goes together."""
        if not 1 <= self.jobs <= 256:
            raise FieldError("jobs", self.jobs, "must be from 1 to 256.")
        if self.list:
            return
        if self.verify is not None:
            if self.planner is not None or self.out is not None or self.task or self.quick:
                raise UsageError(
                    "`verify` reads planner, tasks and tier from the submission: leave them out."
                )
        elif self.planner is None or self.out is None:
            raise UsageError("give `planner` and `out`; `list` shows the tasks.")
        elif self.rerun:
            raise UsageError("`rerun` goes with `verify`.")


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """List the tasks, run them or check a submission, and return the exit code."""
    try:
        if options.list:
            return _list()
        return _run(options) if options.verify is None else _verify(options)
    except KeyboardInterrupt:
        print("sounding: interrupted; finished trials are kept, call again to go on.", file=sys.stderr)
        return INTERRUPTED


def _list() -> int:
    from sim.bench.tasks import SCORES, all_tasks

    width = max(len(task.name) for task in all_tasks())
    for task in all_tasks():
        print(f"{task.name:<{width}}  {len(task.seeds):>3} seeds ({task.n_quick} quick)  {task.title}")
        print(
            f"{'':<{width}}  at most {task.steps} actions; {SCORES[task.score]} ({task.direction} is better)"
        )
    return 0


def _run(options: Options) -> int:
    from sim.bench.run import BenchSettings, run_bench
    from sim.bench.submission import submission_text
    from sim.bench.tasks import named_tasks

    assert options.planner is not None
    assert options.out is not None
    tasks = named_tasks(options.task)
    settings = BenchSettings(quick=options.quick, n_jobs=options.jobs, key=_key(options))
    content = run_bench(options.planner, tasks, options.out, settings, notify=note)
    if content is None:
        return INTERRUPTED
    print(submission_text(content))
    print(f"written to {options.out / 'submission'}")
    return 0


def _verify(options: Options) -> int:
    from sim.bench.verify import verify

    assert options.verify is not None
    found = verify(options.verify, rerun=options.rerun, key=_key(options), n_jobs=options.jobs)
    for fault in found.faults:
        print(f"does not hold: {fault}.")
    if found.is_interrupted:
        return INTERRUPTED
    if found.faults:
        return NOT_USABLE
    how = "run again by the planner" if options.rerun else "replayed from the recorded poses"
    told = "is the same to the last digit"
    if found.n_near:
        told = f"is the same, in {found.n_near} of them not to the last digit, as on another processor"
    if found.n_failed and not options.rerun:
        n = found.n_failed
        told += f"; {n} that failed there have no end to compare, and count as the worst"
    print(f"verified: {found.n_trials} trials were {how}, and every result and score {told}.")
    return 0


def _key(options: Options) -> bytes | None:
    from sim.bench.hidden_seeds import read_key

    return None if options.key is None else read_key(options.key)

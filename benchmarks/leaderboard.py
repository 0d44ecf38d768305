"""The leaderboard: docs/leaderboard.md, made from the submissions in benchmarks/submissions.

.venv/bin/python -m benchmarks.leaderboard                # writes the page
.venv/bin/python -m benchmarks.leaderboard --run quick    # first runs Sounding's own planners; `full` takes all seeds
"""

from __future__ import annotations

import json
import shutil
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from typing import Any

from sim.bench.run import BenchSettings, run_bench
from sim.bench.submission import SUBMISSION, read_submission, score_text
from sim.bench.tasks import SCORES, Task, all_tasks
from sim.tables import markdown_table

ROOT = Path(__file__).resolve().parents[1]
SUBMISSIONS = ROOT / "benchmarks" / "submissions"
LIMITS = {"sphere-v1": ROOT / "benchmarks" / "limits" / "sphere.json"}
"""The bound.json that `sounding bound` wrote for a task's scenario and arm."""
PAGE = ROOT / "docs" / "leaderboard.md"
RUNS = ROOT / "renders" / "leaderboard"
OURS = ("find-and-outline", "expected-improvement", "mutual-information", "trained", "random")
"""Sounding's own planners that are entered."""
INTRODUCTION = """# The leaderboard

Scores of [Sounding-Bench](bench.md) with 95 % intervals over the seeds. `.venv/bin/python -m benchmarks.leaderboard`
makes this page of the submissions in `benchmarks/submissions`, each of which `.venv/bin/sounding bench --verify`
checks. Do not edit it. Scores of a quick tier are of one to six seeds: too few to rank by. They stand below those of
the full tier."""
LIMIT_NOTE = (
    "The limit is the least mean of any policy on the task's scenario, adaptive or drawn by lot, and in brackets what "
    "it is at least with 95 % confidence ([bound.md](bound.md)). It is no bound on the mean of a few seeds. It was "
    "proven on {n_places:,} places of the tumour; more places prove more."
)


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--run", choices=("quick", "full"))
    parser.add_argument("--planner", nargs="+", default=OURS)
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    for planner in arguments.planner if arguments.run else ():
        enter(planner, quick=arguments.run == "quick", n_jobs=arguments.jobs)
    PAGE.write_text(page(load_submissions()), encoding="utf-8")
    print(f"written to {PAGE}")


def enter(planner: str, *, quick: bool, n_jobs: int) -> None:
    """Run one of Sounding's own planners, and keep its submission."""
    out = RUNS / f"{planner}-{'quick' if quick else 'full'}"
    if run_bench(planner, all_tasks(), out, BenchSettings(quick=quick, n_jobs=n_jobs)) is None:
        raise SystemExit("interrupted; call again to go on")
    folder = SUBMISSIONS / planner
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(out / "submission", folder)


def load_submissions(folder: Path = SUBMISSIONS) -> dict[str, dict[str, Any]]:
    """What each submission says, by the name of its folder."""
    return {path.parent.name: read_submission(path.parent) for path in sorted(folder.glob(f"*/{SUBMISSION}"))}


def page(submissions: dict[str, dict[str, Any]]) -> str:
    """The page of some submissions."""
    parts = [INTRODUCTION, "## Submissions", submissions_table(submissions), "## Tasks"]
    parts += [scores_table(task, submissions) for task in all_tasks()]
    return "\n\n".join(parts) + "\n"


def submissions_table(submissions: dict[str, dict[str, Any]]) -> str:
    """Who entered, with what."""
    rows = [
        (
            name,
            f"`{each['planner']['text']}`",
            each["planner"]["map"],
            each["tier"],
            "hidden" if each["key"] else "public",
            each["versions"]["sounding"],
            f"{each['trial_s'] / 60:.1f}",
        )
        for name, each in submissions.items()
    ]
    return markdown_table(
        ("submission", "planner", "map", "tier", "seeds", "version", "minutes of one core"), rows
    )


def scores_table(task: Task, submissions: dict[str, dict[str, Any]]) -> str:
    """The scores of a task, the best first, beside the limit where one is known."""
    found = [
        (name, each["tasks"][task.name], each["tier"])
        for name, each in submissions.items()
        if each["tasks"].get(task.name, {}).get("digest") == task.digest
    ]
    sign = -1.0 if task.direction == "higher" else 1.0
    found.sort(key=lambda one: (one[2] != "full", sign * one[1]["mean"]))
    rows = [(name, tier, str(part["n"]), score_text(part)) for name, part, tier in found]
    more = ""
    if (limit := LIMITS.get(task.name)) is not None:
        bound = json.loads(limit.read_text(encoding="utf-8"))
        least = bound["policy"]["generator"]
        rows.append(("*the limit*", "", "", f"{least['least_mean']:.2f} [{least['least_mean_95']:.2f}]"))
        more = "\n\n" + LIMIT_NOTE.format(n_places=bound["n_places"])
    better = "fewer" if task.direction == "lower" else "more"
    told = f"{task.title}. At most {task.steps} actions; {SCORES[task.score]}, {better} is better."
    return f"### {task.name}\n\n{told}\n\n{markdown_table(('submission', 'tier', 'trials', 'score'), rows)}{more}"


if __name__ == "__main__":
    main()

"""The tasks: files that say all that matters, with a digest each, so that a task of one name never changes."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from sim.campaign.study import parse_seeds
from sim.errors import UsageError
from sim.suggestions import did_you_mean

FROZEN_DIR = Path(__file__).parent / "frozen"
TASKS_DIR, SCENARIOS_DIR = FROZEN_DIR / "tasks", FROZEN_DIR / "scenarios"
SENSINGS = "sensings_to_95"
SCORES = {
    SENSINGS: "sensing actions until 95 % of the tumours was sensed",
    "auprc": "AUPRC of the map after the last action",
    "lesions_found_fraction": "share of a trial's lesions that the map found after the last action",
}
"""What a task may be scored by, in words; the keys are columns of a campaign's trials.csv."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """A task as its files say it."""

    name: str
    """Name with its version, such as `sphere-v1`."""
    title: str
    order: int
    """Place in the table of tasks."""
    scenario: Path
    """The scenario's file."""
    episode: dict[str, Any] = field(hash=False)
    """Options of an episode."""
    seeds: tuple[int, ...]
    """The public seeds."""
    n_quick: int
    """How many of the seeds the quick tier has."""
    score: str
    """The primary score: a key of `SCORES`."""
    direction: Literal["lower", "higher"]
    """Which values of the score are good."""
    truth: str
    """Digest of the truth planted for the first public seed."""
    digest: str
    """SHA-256 of what the task's two files say, but for its title and its place in the table."""

    @property
    def steps(self) -> int:
        """Sensing actions at most."""
        return int(self.episode["steps"])

    @property
    def worst(self) -> float:
        """The score of a trial that failed."""
        return float(self.steps) if self.direction == "lower" else 0.0

    @property
    def measures(self) -> tuple[str, ...]:
        """The results of a trial that are kept; tasks that may keep no map have none of a map."""
        sensed = ("n_sensings", SENSINGS, "sensed_fraction")
        if self.score == SENSINGS:
            return sensed
        return (
            *sensed,
            "auprc",
            "n_lesions",
            "n_lesions_found",
            "lesions_found_fraction",
            "n_false_findings",
        )

    def n_trials(self, *, quick: bool) -> int:
        """How many trials a tier has."""
        return self.n_quick if quick else len(self.seeds)


@lru_cache(maxsize=1)
def all_tasks() -> tuple[Task, ...]:
    """The tasks that Sounding brings along, in the order of their table."""
    return tuple(sorted(map(load_task, TASKS_DIR.glob("*.toml")), key=lambda task: task.order))


def named_tasks(names: Sequence[str] = ()) -> tuple[Task, ...]:
    """The tasks of some names, in the order of the table; all of them where no name is given.

    Raises:
        UsageError: There is no such task.
    """
    known = [task.name for task in all_tasks()]
    for name in names:
        if name not in known:
            raise UsageError(f"task {name!r}: not one of {', '.join(known)}.{did_you_mean(name, known)}")
    return tuple(task for task in all_tasks() if not names or task.name in names)


def load_task(path: Path) -> Task:
    """The task that a file describes, whose scenario lies in the folder `scenarios` beside the file's own.

    Raises:
        OSError, KeyError, tomllib.TOMLDecodeError: The file is no task.
    """
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    scenario = path.parent.parent / "scenarios" / f"{table['scenario']}.toml"
    meant = {name: value for name, value in table.items() if name not in ("title", "order")}
    said = {"task": meant, "scenario": tomllib.loads(scenario.read_text(encoding="utf-8"))}
    return Task(
        **{
            name: table[name] for name in ("name", "title", "order", "n_quick", "score", "direction", "truth")
        },
        scenario=scenario,
        episode=table["episode"],
        seeds=tuple(parse_seeds(table["seeds"])),
        digest=hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest(),
    )

"""The study of a task: its trials by a planner, or by the poses that were recorded of one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sim.campaign.study import Part, Study
from sim.running.fields import converted

from .hidden_seeds import hidden_seed
from .recorded_poses import TEXT
from .results import Record
from .tasks import Task


def seeds_of(task: Task, *, quick: bool, key: bytes | None) -> tuple[int, ...]:
    """The seeds of a tier of a task: public ones, or those that a key hides."""
    n = task.n_trials(quick=quick)
    if key is None:
        return task.seeds[:n]
    return tuple(hidden_seed(key, task.name, index) for index in range(n))


def planner_study(task: Task, planner: str, map_settings: str, seeds: Sequence[int]) -> Study:
    """A planner's trials of a task."""
    values = _values(task, map_settings) | {"planner": (planner,), "seed": tuple(seeds)}
    return Study(task.name, (Part(values),))


def replay_study(task: Task, map_settings: str, seeds: Sequence[int], records: Sequence[Record]) -> Study:
    """The trials of a task by the poses of records, one for each seed."""
    parts = [
        Part(
            _values(task, map_settings)
            | {"planner": (TEXT,), "planner_option": ((f"poses={record['poses']}",),), "seed": (seed,)}
        )
        for seed, record in zip(seeds, records, strict=True)
    ]
    return Study(f"replay of {task.name}", tuple(parts))


def _values(task: Task, map_settings: str) -> dict[str, tuple[Any, ...]]:
    given = {"scenario": str(task.scenario), "map_settings": map_settings, **task.episode}
    return {name: (converted(name, value),) for name, value in given.items()}

"""Does the default planner stop too early where the reader errs? It stops when it is sure that nothing is left.

    .venv/bin/python -m benchmarks.readers_stopping [--scenario spheres] [--reader published] [--seeds 100]

Episodes of find-and-outline with a free probe and learnt rates, which end at a confidence of 95 per cent or after
`--readings`. One has stopped too early if it ended by confidence and the map calls nothing of a lesion that can be
seen.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
import tyro
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from benchmarks.readers import ERRORS, Reader, lesions_of, setup_of
from mapping import DetailSettings, TrustSettings
from planner import make_planner
from sim.episode.episode import Episode
from sim.tables import markdown_table
from sim.world.sensing.errors.erring_sensor import ErringSensor


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print one row."""

    scenario: str = "spheres"
    reader: Reader = "published"
    readings: int = 150
    confidence: float = 0.95
    seeds: int = 100
    first: int = 0
    """First seed."""
    jobs: int = 2


def play(seed: int, options: Options) -> dict[str, Any]:
    """How one episode ended, after how many actions, and whether each lesion that can be seen was found."""
    with threadpool_limits(1):
        episode = Episode(
            setup_of(options.scenario),
            make_planner("find-and-outline"),
            seed=seed,
            sensor=ErringSensor(errors=ERRORS[options.reader]),
            trust=TrustSettings(),
            detail=DetailSettings.of_many_labels(),
        )
        n_steps = sum(1 for _ in episode.steps(options.readings, until_confident=options.confidence))
    assert episode.prediction is not None
    lesions = lesions_of(episode, episode.prediction.score)["lesions"]
    return {
        "n_steps": n_steps,
        "ended_by": episode.ended_by,
        "is_all_found": all(is_found for _, is_found, is_visible in lesions if is_visible),
    }


def main(options: Options) -> None:
    """Print the row."""
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        seeds = range(options.first, options.first + options.seeds)
        runs = list(tqdm(pool.map(partial(play, options=options), seeds), total=len(seeds)))
    stopped = [each for each in runs if each["ended_by"] == "confident"]
    actions = f"{np.mean([each['n_steps'] for each in stopped]):.1f}" if stopped else "-"
    too_early = sum(not each["is_all_found"] for each in stopped)
    head = [f"{options.scenario}, {options.reader}", "seeds", "stopped", "actions of these", "too early"]
    row = ["", str(len(runs)), str(len(stopped)), actions, f"{too_early} of {len(stopped)}"]
    print(markdown_table(head, [row]))


if __name__ == "__main__":
    # Worker processes find functions by the name of their module, which is not `__main__` there.
    from benchmarks import readers_stopping

    readers_stopping.main(tyro.cli(readers_stopping.Options))

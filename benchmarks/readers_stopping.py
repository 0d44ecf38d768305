"""Does the default planner stop too early where the reader errs? It stops when it is sure that nothing is left.

    .venv/bin/python -m benchmarks.readers_stopping [--scenario spheres] [--reader published] [--seeds 100] [--jobs 2]

Episodes of find-and-outline with a free probe and learnt rates, which end at a confidence of 95 per cent or after
`--readings`. One has stopped too early if it ended by confidence and the map calls nothing of a lesion of 16 mm or
more that can be seen: of smaller ones the confidence says nothing, and they are counted besides. The second table has
what was stated at every tenth action against the share of these statements at which nothing of that size was left; the
interval counts each seed once at most.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from typing import Any

import numpy as np
import tyro
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from benchmarks.readers import ERRORS, Reader, lesions_of, setup_of
from mapping import DetailSettings, TrustSettings, average_precision, dice
from planner import make_planner
from sim.comparison.estimates import share_interval
from sim.comparison.texts import interval_text
from sim.episode.episode import Episode
from sim.tables import markdown_table
from sim.world.sensing.errors.erring_sensor import ErringSensor

_SURE_DIAMETER_MM = 16.0
"""Smallest diameter of the lesions that the confidence is about [mm]."""
_EVERY = 10
"""Actions from one statement to the next."""
_BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
"""Edges of what is stated."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print the tables."""

    scenario: str = "spheres"
    reader: Reader = "published"
    readings: int = 300
    confidence: float = 0.95
    seeds: int = 100
    first: int = 0
    """First seed."""
    jobs: int = 2


def play(seed: int, options: Options) -> dict[str, Any]:
    """How one episode ended, after how many actions, what was missed, and what was stated on the way."""
    with threadpool_limits(1):
        exact = options.reader == "exact"
        episode = Episode(
            setup_of(options.scenario),
            make_planner("find-and-outline"),
            seed=seed,
            sensor=ErringSensor(errors=ERRORS[options.reader]),
            trust=None if exact else TrustSettings(),
            detail=DetailSettings() if exact else DetailSettings.of_many_labels(),
        )
        n_steps, statements = 0, []
        for step in episode.steps(options.readings, until_confident=options.confidence):
            n_steps = step.step
            if n_steps % _EVERY == 0 or episode.ended_by:
                statements.append((episode.confidence(), _n_missed(episode, _SURE_DIAMETER_MM) == 0))
    assert episode.prediction is not None
    score, truth = episode.prediction.score, episode.truth.is_tumour
    return {
        "n_steps": n_steps,
        "ended_by": episode.ended_by,
        "n_missed": _n_missed(episode, _SURE_DIAMETER_MM),
        "n_missed_small": _n_missed(episode, 0.0) - _n_missed(episode, _SURE_DIAMETER_MM),
        "statements": statements,
        "auprc": average_precision(score, truth),
        "dice": dice(score > 0, truth),
    }


def _n_missed(episode: Episode, least_mm: float) -> int:
    """The number of lesions of a diameter [mm] or more that can be seen and of which the map calls nothing."""
    assert episode.prediction is not None
    lesions = lesions_of(episode, episode.prediction.score)["lesions"]
    return sum(
        not is_found for diameter, is_found, is_visible in lesions if is_visible and diameter >= least_mm
    )


def stated_rows(runs: list[dict[str, Any]]) -> list[list[str]]:
    """For each bin of what was stated: the number of statements, their mean, and the share that was true."""
    stated, true = (np.array([each[i] for run in runs for each in run["statements"]], float) for i in (0, 1))
    rows = []
    for low, high in pairwise(_BINS):
        held = (stated >= low) & ((stated < high) | (high == 1.0))
        if held.any():
            n, mean = min(int(held.sum()), len(runs)), float(true[held].mean())
            told = f"{mean:.3f} {interval_text(share_interval(mean, n), '{:.2f}')}"
            rows.append([f"{low:g} to {high:g}", str(int(held.sum())), f"{stated[held].mean():.3f}", told])
    return rows


def _count(is_so: list[bool]) -> str:
    """How many are so of how many, with Wilson's interval of the share."""
    if not is_so:
        return "-"
    interval = share_interval(float(np.mean(is_so)), len(is_so))
    return f"{sum(is_so)} of {len(is_so)} {interval_text(interval, '{:.2f}')}"


def main(options: Options) -> None:
    """Print both tables."""
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        seeds = range(options.first, options.first + options.seeds)
        work, runs = partial(play, options=options), []
        for seed, run in zip(seeds, tqdm(pool.map(work, seeds), total=len(seeds)), strict=True):
            runs.append(run)
            print(seed, run["ended_by"], run["n_steps"], run["n_missed"], run["n_missed_small"], flush=True)
    stopped = [each for each in runs if each["ended_by"] == "confident"]
    actions, auprc, overlap = (
        f"{np.mean([each[key] for each in stopped]):{form}}" if stopped else "-"
        for key, form in (("n_steps", ".1f"), ("auprc", ".3f"), ("dice", ".3f"))
    )
    early, small = (_count([each[key] > 0 for each in stopped]) for key in ("n_missed", "n_missed_small"))
    head = [
        f"{options.scenario}, {options.reader}",
        "seeds",
        "stopped",
        "actions of these",
        "AUPRC",
        "Dice",
        "too early",
        "missed smaller ones",
    ]
    row = ["", str(len(runs)), str(len(stopped)), actions, auprc, overlap, early, small]
    print("\n" + markdown_table(head, [row]))
    print("\n" + markdown_table(["stated", "statements", "mean", "true"], stated_rows(runs)))


if __name__ == "__main__":
    # Worker processes find functions by the name of their module, which is not `__main__` there.
    from benchmarks import readers_stopping

    readers_stopping.main(tyro.cli(readers_stopping.Options))

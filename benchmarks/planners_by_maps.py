"""How much of a score is the planner's, and how much the map's? Planners crossed with maps, on the same readings.

    .venv/bin/python -m benchmarks.planners_by_maps [--scenario spheres] [--seeds 40] [--at 20 50] [--jobs 2]
        [--out renders/planners_by_maps.jsonl]

Each planner plays an episode with the map that it prefers, without an arm; then every map learns its readings. So a
row has the readings of one planner, a column one map, and all of them the same tumours. Below stand the paired
differences between the first planner and the others on each map, and, for the first planner's readings, between the
first map and the others. The file `--out` keeps each episode as it ends, so the benchmark, called again, goes on where
it was stopped. A change of the code needs a new file.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from mapping import DetailedMap, DetailSettings, HilbertMap, MapSettings, average_precision
from planner import make_planner
from sim.comparison.estimates import mean_estimate
from sim.comparison.texts import interval_text
from sim.episode.episode import Episode
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import Setup, build_setup
from sim.tables import markdown_table
from sim.world.sensing.reading import Reading

from .kept_episodes import KeptEpisodes

MAPS: dict[str, tuple[MapSettings, DetailSettings | None]] = {
    "in detail": (MapSettings(), DetailSettings()),
    "calibrated": (MapSettings(), None),
    "the paper's": (MapSettings.paper(), None),
}
"""The maps that learn: their settings, and whether they answer in detail near sensed tumour."""
PREFERRED = {"calibrated": "in detail", "paper": "the paper's"}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print AUPRC by planner and map, and the paired differences."""

    scenario: str = "spheres"
    """Scenario, without an arm."""
    planners: tuple[str, ...] = (
        "find-and-outline",
        "expected-improvement",
        "upper-confidence-bound",
        "mutual-information",
        "random",
    )
    """Whose readings are learnt; the first is compared with the others."""
    at: tuple[int, ...] = (20, 50)
    """Numbers of actions after which AUPRC is reported."""
    seeds: int = 40
    first: int = 0
    """First seed."""
    jobs: int = 2
    """Number of processes."""
    out: Path = Path("renders/planners_by_maps.jsonl")
    """File that keeps every episode."""


@lru_cache(maxsize=1)
def setup_of(scenario: str) -> Setup:
    """Organ and workspace, which all seeds share."""
    return build_setup(load_scenario(scenario), None, MapSettings())


def settings_of(seed_and_planner: tuple[int, str], options: Options) -> dict[str, Any]:
    """The settings by which an episode is known."""
    seed, planner = seed_and_planner
    return {"scenario": options.scenario, "seed": seed, "planner": planner, "at": list(options.at)}


def play(seed_and_planner: tuple[int, str], options: Options) -> dict[str, Any]:
    """AUPRC on each map after the actions asked for, shape (maps, actions)."""
    with threadpool_limits(1):
        return {"auprc": _scores(*seed_and_planner, options)}


def _scores(seed: int, planner_name: str, options: Options) -> list[list[float | None]]:
    setup, planner = setup_of(options.scenario), make_planner(planner_name)
    own = PREFERRED[planner.preferred_map]
    settings, detail = MAPS[own]
    episode = Episode(setup, planner, seed=seed, map_settings=settings, detail=detail)
    readings, truth, scores = [], episode.truth.is_tumour, {own: []}
    for step in episode.steps(max(options.at)):
        readings.append(step.reading)
        if len(readings) in options.at:
            assert episode.tumour_map is not None
            scores[own].append(average_precision(episode.tumour_map.predict_lattice().score, truth))
    for name, (settings, detail) in MAPS.items():
        if name != own:
            scores[name] = _learnt(setup, settings, detail, readings, truth, options.at)
    return [scores[name] for name in MAPS]


def _learnt(
    setup: Setup,
    settings: MapSettings,
    detail: DetailSettings | None,
    readings: list[Reading],
    truth: NDArray[np.bool_],
    at: tuple[int, ...],
) -> list[float]:
    coarse = HilbertMap(
        setup.hinges, settings, query=setup.query, query_mask=setup.is_inside, hinge_mask=setup.hinge_mask
    )
    belief = coarse if detail is None else DetailedMap(coarse, detail)
    scores = []
    for number, reading in enumerate(readings, start=1):
        belief.update(reading.points_m, reading.is_occupied)
        if number in at:
            scores.append(average_precision(belief.predict_lattice().score, truth) or 0.0)
    return scores


def _text(values: NDArray[np.float64]) -> str:
    estimate = mean_estimate(values)
    return f"{estimate.mean:.3f} {interval_text(estimate.interval, '{:.3f}')}"


def main(options: Options) -> None:
    """Print the tables."""
    seeds = range(options.first, options.first + options.seeds)
    known_by, work = partial(settings_of, options=options), partial(play, options=options)
    jobs = [(seed, planner) for seed in seeds for planner in options.planners]
    with KeptEpisodes[tuple[int, str]](options.out, work, known_by, n_jobs=options.jobs) as kept:
        rows = [row["auprc"] for row in kept.rows(jobs)]
    scores = np.array(rows, dtype=float).reshape(
        len(seeds), len(options.planners), len(MAPS), len(options.at)
    )
    names = list(MAPS)
    for k, n in enumerate(options.at):
        head = [f"AUPRC at {n}, readings of", *(f"map {name}" for name in names)]
        rows = [
            [planner, *(_text(scores[:, i, j, k]) for j in range(len(names)))]
            for i, planner in enumerate(options.planners)
        ]
        rows += [
            [
                f"first − {planner}",
                *(_text(scores[:, 0, j, k] - scores[:, i, j, k]) for j in range(len(names))),
            ]
            for i, planner in enumerate(options.planners)
            if i > 0
        ]
        rows.append(
            ["first map − this one", "–", *(_text(scores[:, 0, 0, k] - scores[:, 0, j, k]) for j in (1, 2))]
        )
        print("\n" + markdown_table(head, rows))


if __name__ == "__main__":
    # Worker processes find functions by the name of their module, which is not `__main__` there.
    from benchmarks import planners_by_maps

    planners_by_maps.main(tyro.cli(planners_by_maps.Options))

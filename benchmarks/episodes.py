"""Many episodes of one scenario and planner, with a summary: `.venv/bin/python -m benchmarks.episodes --help`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import tyro
from threadpoolctl import threadpool_limits

from sim.episode.episode import Episode
from sim.episode.setup import Setup, build_setup
from sim.running.config import EpisodeConfig
from sim.running.parts import make_parts
from sim.workers import Workers


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run seeds FIRST to FIRST + COUNT - 1 of an episode and print a row each and a summary."""

    episode: tyro.conf.OmitArgPrefixes[EpisodeConfig]
    """The episode, whose seed is replaced."""
    first: int = 0
    """First seed."""
    count: int = 20
    """Number of seeds."""
    jobs: int = 2
    """Number of processes."""
    at: tuple[int, ...] = (10, 20, 30, 50)
    """Numbers of actions after which AUPRC is reported."""


@lru_cache(maxsize=2)
def _setup(config: EpisodeConfig) -> Setup:
    parts = make_parts(config)
    return build_setup(parts.scenario, parts.arm, parts.map_settings)


def run_seed(config: EpisodeConfig, at: tuple[int, ...]) -> dict[str, Any]:
    """The row of an episode."""
    with threadpool_limits(limits=1):
        setup, parts = _setup(replace(config, seed=0)), make_parts(config)
        episode = Episode(
            setup,
            parts.planner,
            seed=parts.seed,
            map_settings=parts.map_settings,
            detail=parts.detail,
            sensor=parts.sensor,
        )
        auprc: list[float] = []
        sensed: list[float] = []
        for step in episode.steps(parts.n_steps, **parts.stops):
            auprc.append(np.nan if step.auprc is None else step.auprc)
            sensed.append(np.nan if step.sensed_fraction is None else step.sensed_fraction)
    reached = np.flatnonzero(np.array(sensed) >= 0.95)
    return {
        "seed": config.seed,
        "n_sensings": len(sensed),
        "sensings_to_95": int(reached[0]) + 1 if reached.size else None,
        "sensed_fraction": sensed[-1],
        **{f"auprc_{n}": auprc[n - 1] if len(auprc) >= n else None for n in at},
    }


def main(options: Options) -> None:
    """Run the seeds and print."""
    at = tuple(n for n in options.at if n <= options.episode.steps)
    seeds = range(options.first, options.first + options.count)
    configs = [replace(options.episode, seed=seed) for seed in seeds]
    rows: list[dict[str, Any]] = []
    with Workers[EpisodeConfig, dict[str, Any]](partial(run_seed, at=at), n_jobs=options.jobs) as workers:
        for row in workers.in_order(configs, lost="one seed."):
            rows.append(row)
            print(row, flush=True)
    sensings = np.array([row["sensings_to_95"] or np.nan for row in rows], dtype=float)
    done = sensings[np.isfinite(sensings)]
    print(f"never to 95 %: {np.isnan(sensings).mean():.0%} of {len(rows)}")
    if done.size:
        capped = np.where(np.isnan(sensings), options.episode.steps, sensings)
        print(
            f"sensings to 95 %: mean {done.mean():.1f}, median {np.median(done):.1f}, sd {done.std(ddof=1):.1f} "
            f"of those that get there; restricted mean (cap {options.episode.steps}) {capped.mean():.1f}"
        )
    for n in at:
        values = np.array([row[f"auprc_{n}"] for row in rows if row[f"auprc_{n}"] is not None], dtype=float)
        if values.size:
            print(f"AUPRC at {n}: mean {values.mean():.3f}, sd {values.std(ddof=1):.3f} over {values.size}")


if __name__ == "__main__":
    # Worker processes find functions by the name of their module, which is not `__main__` there.
    from benchmarks import episodes

    episodes.main(tyro.cli(episodes.Options))

"""Find-and-outline on scenarios that it was not tuned on, with its stopping rule.

Run it by `.venv/bin/python -m benchmarks.robustness`.

Variations of the paper's scenario 1 with a free probe. Every episode runs until the planner is 95 % confident that
nothing of 8 mm radius or more is left (6 mm where the tumours are that small), or until its actions are used up. So
one run tells both how soon 95 % was sensed and whether the episode ended too early. The file `--out` keeps each episode
as it ends, so the benchmark, called again, goes on where it was stopped. A change of the code needs a new file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from threadpoolctl import threadpool_limits

from mapping import DetailSettings, MapSettings
from planner import FindAndOutline
from sim.comparison.estimates import mean_estimate, share_interval
from sim.comparison.tables import interval_text
from sim.episode.episode import Episode
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import Setup, build_setup
from sim.tables import markdown_table
from sim.world.sensing.reading import Reading

from .kept_episodes import KeptEpisodes

SENSED = 0.95
Job = tuple[int, int]
"""Number of the case, and seed of an episode."""
NOISE_STREAM = 1
"""Number that keeps the wrong labels apart from everything else that a seed draws."""


@dataclass(frozen=True)
class Case:
    """A variation of scenario 1."""

    label: str
    changes: dict[str, Any] = field(default_factory=dict)
    """Fields of the scenario that differ."""
    noise: float = 0.0
    """Share of the labels that the sensor gets wrong."""
    is_told: bool = False
    """Whether the map is told that share."""
    sure_radius_m: float = FindAndOutline().sure_radius_m
    """Radius of the smallest tumours that the stopping rule is about [m]."""


CASES = (
    Case("scenario 1"),
    Case("radius 6 mm", {"tumour_radius_m": 0.006}, sure_radius_m=0.006),
    Case("radius 24 mm", {"tumour_radius_m": 0.024}),
    Case("3 tumours", {"n_tumours": 3}),
    Case("6 tumours", {"n_tumours": 6}),
    Case("cone of 8 degrees", {"cone_half_angle_rad": math.radians(8.0)}),
    Case("cone of 20 degrees", {"cone_half_angle_rad": math.radians(20.0)}),
    Case("5 % wrong labels, told", noise=0.05, is_told=True),
    Case("5 % wrong labels, not told", noise=0.05),
    Case("no tumour", {"n_tumours": 0}),
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run every variation on some seeds, and print a table."""

    seeds: int = 20
    """Number of seeds, from 0 on, of every case but the first."""
    first_seeds: int = 100
    """Number of seeds of the first case, scenario 1 itself."""
    steps: int = 150
    """Largest number of sensing actions."""
    confidence: float = 0.95
    """Confidence at which an episode ends."""
    jobs: int = 2
    """Number of processes."""
    out: Path = Path("renders/robustness.jsonl")
    """File that keeps every episode."""
    cases: tuple[int, ...] = tuple(range(len(CASES)))
    """Numbers of the cases to run."""


class NoisyEpisode(Episode):
    """An episode whose sensor gets a share of its labels wrong, which are drawn from a stream of their own."""

    noise = 0.0
    noise_rng = np.random.default_rng(0)

    def _read(self) -> Reading:
        reading = super()._read()
        is_wrong = self.noise_rng.random(len(reading.is_occupied)) < self.noise
        return replace(reading, is_occupied=reading.is_occupied ^ is_wrong)


@lru_cache(maxsize=1)
def _setup(number: int) -> Setup:
    scenario = replace(SCENARIOS["sphere"], **CASES[number].changes)
    return build_setup(scenario, None, MapSettings())


def settings_of(job: Job, options: Options) -> dict[str, Any]:
    """The settings by which an episode is known."""
    number, seed = job
    limits = {"steps": options.steps, "confidence": options.confidence}
    return {"case": CASES[number].label, "seed": seed, **limits}


def play(job: Job, *, options: Options) -> dict[str, Any]:
    """An episode: actions until 95 % was sensed (None for never), actions in all, share sensed, whether it stopped."""
    number, seed = job
    case = CASES[number]
    told = {"false_positive_rate": case.noise, "false_negative_rate": case.noise} if case.is_told else {}
    with threadpool_limits(limits=1):
        planner = FindAndOutline(sure_radius_m=case.sure_radius_m)
        settings = replace(MapSettings(), **told)
        episode = NoisyEpisode(
            _setup(number), planner, seed=seed, map_settings=settings, detail=DetailSettings()
        )
        episode.noise, episode.noise_rng = case.noise, np.random.default_rng((seed, NOISE_STREAM))
        sensings, sensed, n_steps = None, None, 0
        for step in episode.steps(options.steps, until_confident=options.confidence):
            sensed, n_steps = step.sensed_fraction, step.step
            if sensings is None and (sensed or 0.0) >= SENSED:
                sensings = step.step
        has_stopped = episode.confidence() >= options.confidence
    return {"sensings": sensings, "n_steps": n_steps, "sensed_fraction": sensed, "has_stopped": has_stopped}


def table_row(number: int, rows: list[dict[str, Any]], options: Options) -> list[str]:
    """The line of a case in the table."""
    n, stopped = len(rows), [row for row in rows if row["has_stopped"]]
    ends = [row["n_steps"] for row in stopped]
    end = f"{np.mean(ends):.0f} ({min(ends)}-{max(ends)})" if ends else "-"
    if rows[0]["sensed_fraction"] is None:
        return [CASES[number].label, str(n), "-", "-", f"{len(stopped)} of {n}", end, "-"]
    sensings = [row["sensings"] for row in rows]
    capped = mean_estimate(
        np.array([options.steps if each is None else each for each in sensings], dtype=float)
    )
    n_early = sum(row["sensed_fraction"] < SENSED for row in stopped)
    early = "-"
    if stopped:
        low, high = share_interval(n_early / len(stopped), len(stopped))
        early = f"{n_early} [{low:.0%}, {high:.0%}]"
    return [
        CASES[number].label,
        str(n),
        f"{capped.mean:.1f} ± {capped.deviation:.1f} {interval_text(capped.interval, '{:.1f}')}",
        f"{sensings.count(None)}",
        f"{len(stopped)} of {n}",
        end,
        early,
    ]


def main(options: Options) -> None:
    """Run the cases and print the table."""
    head = ("case", "seeds", "sensings to 95 %", "never", "stopped by itself", "after (range)", "too early")
    rows = []
    known_by, work = partial(settings_of, options=options), partial(play, options=options)
    with KeptEpisodes[Job](options.out, work, known_by, n_jobs=options.jobs) as kept:
        for number in options.cases:
            n_seeds = options.first_seeds if number == 0 else options.seeds
            played = kept.rows([(number, seed) for seed in range(n_seeds)], CASES[number].label)
            rows.append(table_row(number, played, options))
            print(" | ".join(rows[-1]), flush=True)
    print(markdown_table(head, rows))


if __name__ == "__main__":
    # Worker processes find functions by the name of their module, which is not `__main__` there.
    from benchmarks import robustness

    robustness.main(tyro.cli(robustness.Options))

"""Learns the numbers of the planner `trained` in the environment for learning agents, and writes them.

    .venv/bin/python -m benchmarks.train_baseline                     # the shipped numbers, some 30 minutes of one core
    .venv/bin/python -m benchmarks.train_baseline --generations 2 --out renders/weights.json

The cross-entropy method: a generation draws candidates around a mean, all play the same episodes, and mean and
deviations move to those of the best. Every generation has episodes of its own, of seeds from 10,000 on. Episodes keep
no map, since the planner looks at none. The same seed gives the same numbers; `weights.json` tells how it was learned.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from planner import Planner
from planner.trained import N_SEARCH, Trained
from sim.gym import SoundingEnv

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "planner" / "trained" / "weights.json"
FIRST_SEED = 10_000
"""Seed of the first training episode, far from those that planners are compared and tuned on."""
N_CANDIDATES, N_BEST = 14, 4
KEPT = 0.5
"""Share of the old mean and deviations in the new ones, so that the luck of a few episodes does not move them far."""
START = (-3.0, -1.0, -0.5, 0.0, -2.0, -0.3, 0.0, 0.3, 3.0, 3.0, 2.5, 1.0, -1.0, -1.5, 1.0)
"""The first mean, guessed by hand: little is worth beside sensed cones and at the surface, much beside tumour."""
START_DEVIATION = 0.6


@dataclass(frozen=True, kw_only=True)
class Course:
    """The episodes of one scenario."""

    scenario: str
    n_episodes: int
    """Number in a generation."""
    most: int
    """Actions after which an episode is given up and counts with that number."""
    unit: float
    """Actions that count as 1, so that scenarios weigh alike."""


COURSES = (
    Course(scenario="sphere", n_episodes=6, most=40, unit=10.0),
    Course(scenario="spheres", n_episodes=3, most=60, unit=20.0),
    Course(scenario="liver", n_episodes=2, most=40, unit=20.0),
)


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--generations", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    with threadpool_limits(limits=1):
        train(arguments.generations, arguments.seed, arguments.out)


def train(n_generations: int, seed: int, out: Path) -> None:
    """Learn, and write after each generation the average of the last third of the means, in which luck evens out."""
    rng = np.random.default_rng(seed)
    mean, deviation = np.array(START), np.full(len(START), START_DEVIATION)
    envs = [SoundingEnv(c.scenario, keeps_map=False, makes_readings=True, max_steps=c.most) for c in COURSES]
    means: list[NDArray[np.float64]] = []
    start_s = perf_counter()
    for generation in range(n_generations):
        candidates = mean + deviation * rng.standard_normal((N_CANDIDATES, len(mean)))
        costs = costs_of(envs, candidates, generation)
        best = candidates[np.argsort(costs, kind="stable")[:N_BEST]]
        mean = KEPT * mean + (1.0 - KEPT) * best.mean(axis=0)
        deviation = KEPT * deviation + (1.0 - KEPT) * best.std(axis=0)
        print(
            f"generation {generation + 1}: best {costs.min():.3f}, mean {costs.mean():.3f}, "
            f"deviation {deviation.mean():.2f}, {(perf_counter() - start_s) / 60:.1f} min",
            flush=True,
        )
        means.append(mean)
        write(np.mean(means[-(1 + generation // 3) :], axis=0), generation + 1, seed, out)


def costs_of(
    envs: list[SoundingEnv], candidates: NDArray[np.float64], generation: int
) -> NDArray[np.float64]:
    """The mean over scenarios of the actions until 95 % was sensed, in each scenario's unit, shape (n,).

    Args:
        envs: The environment of each course.
        candidates: Numbers of the planner, shape (n, k).
        generation: Whose episodes are played.
    """
    planners = [Trained(weights=tuple(map(float, candidate))) for candidate in candidates]
    needed = np.zeros((len(COURSES), len(planners)))
    # One scenario after the other: a process keeps the setup of the last one only.
    for row, env, course in zip(needed, envs, COURSES, strict=True):
        first = FIRST_SEED + generation * course.n_episodes
        for seed in range(first, first + course.n_episodes):
            row += [actions(env, planner, seed) / (course.n_episodes * course.unit) for planner in planners]
    return needed.mean(axis=0)


def actions(env: SoundingEnv, planner: Planner, seed: int) -> int:
    """The number of actions until 95 % was sensed, or the most that an episode has."""
    env.reset(seed=seed)
    for number in range(1, env.max_steps + 1):
        _, _, is_sensed, is_cut, _ = env.step(next(planner.rank(env.situation())))
        if is_sensed or is_cut:
            return number
    raise AssertionError("an episode ends after its most steps")


def write(weights: NDArray[np.float64], n_generations: int, seed: int, out: Path) -> None:
    """Write the numbers, and how they were learned."""
    rounded = [round(float(weight), 3) for weight in weights]
    told = {
        "learned_by": f".venv/bin/python -m benchmarks.train_baseline --generations {n_generations} --seed {seed}",
        "search": rounded[:N_SEARCH],
        "outline": rounded[N_SEARCH:],
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

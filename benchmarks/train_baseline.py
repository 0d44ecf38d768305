"""Learns the numbers of the planner `trained` in the environment for learning agents, and writes them.

    .venv/bin/python -m benchmarks.train_baseline                     # the shipped numbers, some 35 minutes of one core
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
from tempfile import TemporaryDirectory
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
N_CANDIDATES, N_BEST = 12, 4
KEPT = 0.5
"""Share of the old mean and deviations in the new ones, so that the luck of a few episodes does not move them far."""
START = (-3.0, -1.0, -0.5, 0.0, -2.0, -0.3, 0.0, 0.3, 3.0, 3.0, 2.5, 1.0, -1.0, -1.5, 1.0)
"""The first mean, guessed by hand: little is worth beside sensed cones and at the surface, much beside tumour."""
START_DEVIATION = 0.5
N_POSES = 2500
"""Poses of the liver in training, about half of the scenario's own; the paper's organ has always 14,400."""


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
    Course(scenario="sphere", n_episodes=4, most=40, unit=10.0),
    Course(scenario="spheres", n_episodes=2, most=60, unit=20.0),
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
    with TemporaryDirectory() as folder:
        envs = [environment(course.scenario, course.most, Path(folder)) for course in COURSES]
    means: list[NDArray[np.float64]] = []
    start_s = perf_counter()
    for generation in range(n_generations):
        candidates = mean + deviation * rng.standard_normal((N_CANDIDATES, len(mean)))
        costs = np.array([cost(envs, candidate, generation) for candidate in candidates])
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


def environment(scenario: str, most: int, folder: Path) -> SoundingEnv:
    """The environment of a scenario with fewer poses where it lets itself be told, so that an action takes less time.

    Args:
        scenario: Its name.
        most: Most actions of an episode.
        folder: Where its file is written.
    """
    file = folder / f"{scenario}.toml"
    file.write_text(f'base = "{scenario}"\nn_poses = {N_POSES}\n')
    return SoundingEnv(str(file), keeps_map=False, makes_readings=True, max_steps=most)


def cost(envs: list[SoundingEnv], weights: NDArray[np.float64], generation: int) -> float:
    """The mean over scenarios of the actions until 95 % was sensed, in each scenario's unit."""
    planner = Trained(weights=tuple(map(float, weights)))
    means = []
    for env, course in zip(envs, COURSES, strict=True):
        first = FIRST_SEED + generation * course.n_episodes
        needed = [actions(env, planner, first + index) for index in range(course.n_episodes)]
        means.append(np.mean(needed) / course.unit)
    return float(np.mean(means))


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

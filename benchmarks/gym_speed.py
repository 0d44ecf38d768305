"""Steps a second of the environments for learning, on one core.

    .venv/bin/python -m benchmarks.gym_speed [--steps 3000] [--map-steps 20]

Poses are drawn evenly, episodes are of 100 steps, and the time of a reset counts where it says so. With a map the steps
of one episode are timed.
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from sim.gym import SoundingEnv

ONE_ORGAN = ("sphere", "spheres", "liver")
"""Scenarios of which all seeds have one organ."""


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--map-steps", type=int, default=20)
    arguments = parser.parse_args()
    print("| scenario | steps a second | with resets | reset | with a map |\n|---|---|---|---|---|")
    with threadpool_limits(limits=1):
        for scenario in (*ONE_ORGAN, "generated-liver"):
            print(row(scenario, arguments.steps, arguments.map_steps))


def row(scenario: str, n_steps: int, n_map_steps: int) -> str:
    """A line of the table."""
    n_steps = n_steps if scenario in ONE_ORGAN else 300
    step_s, reset_s = seconds(SoundingEnv(scenario, keeps_map=False), n_steps)
    map_step_s, _ = seconds(SoundingEnv(scenario, max_steps=n_map_steps), n_map_steps)
    with_resets = n_steps / (step_s.sum() + reset_s.sum())
    return (
        f"| `{scenario}` | {1 / step_s.mean():,.0f} | {with_resets:,.0f} | {reset_s.mean() * 1e3:,.0f} ms | "
        f"{1 / map_step_s.mean():,.1f} |"
    )


def seconds(env: SoundingEnv, n_steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The time of each step and of each reset [s]; the first reset is left out, since it builds the setup."""
    rng, seed, is_over = np.random.default_rng(0), 0, False
    step_s, reset_s = [], [0.0]
    _, info = env.reset(seed=seed)
    while len(step_s) < n_steps:
        if is_over:
            start_s = perf_counter()
            _, info = env.reset(seed=(seed := seed + 1))
            reset_s.append(perf_counter() - start_s)
        pose = rng.choice(np.flatnonzero(info["action_mask"]))
        start_s = perf_counter()
        _, _, is_done, is_cut, info = env.step(pose)
        step_s.append(perf_counter() - start_s)
        is_over = is_done or is_cut
    return np.array(step_s), np.array(reset_s[1:] or reset_s)


if __name__ == "__main__":
    main()

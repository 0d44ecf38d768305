"""How well servos hold the force of a sweep: error, slip and lag on soft and on stiff organs.

Run it by `.venv/bin/python -m benchmarks.sweep_forces --help`.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import tyro
from threadpoolctl import threadpool_limits

from sim.episode.moving.held_force import HeldForce, held_together
from sim.episode.moving.motion import Phase
from sim.episode.setup import Setup, build_setup
from sim.episode.step import Step
from sim.running.fields import config_of
from sim.running.parts import EpisodeParts, make_parts
from sim.running.run_episode import make_episode
from sim.tables import markdown_table

HEADER = (
    *("case", "spring [N/m]", "force [N]", "seeds", "slid [s]", "way [m]", "within 20 %", "error, RMS [N]"),
    *("largest [N]", "slip [mm]", "lag [mm]", "other contacts"),
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run sweeps under servos and print a row for each case and spring."""

    cases: tuple[str, ...] = ("sphere", "liver")
    """Scenarios."""
    springs_n_m: tuple[float, ...] = (87.0, 1000.0, 5000.0)
    """Stiffnesses of the organ under the face [N/m]; the first is that of healthy liver under the embedded probe."""
    press_n: float = 2.0
    """Force to hold [N]."""
    seeds: int = 3
    """Seeds, from 0 on."""
    steps: int = 15
    """Actions of each."""


def parts_of(options: Options, case: str, spring_n_m: float, seed: int) -> EpisodeParts:
    """What one run is made of."""
    return make_parts(
        config_of(
            scenario=case, arm="default", motion="servo", sense="sweep", planner="find-and-outline-paths",
            press_n=options.press_n, stiffness_n_m=spring_n_m, seed=seed, steps=options.steps,
        )
    )  # fmt: skip


def other_contacts(setup: Setup, steps: list[Step]) -> int:
    """In how many recorded states anything but the face touches anything: arm, probe and table by MuJoCo."""
    data, n = setup.scene.new_data(), 0
    for step in steps:
        for state in step.motion.states:
            data.qpos[:] = state
            mujoco.mj_fwdPosition(setup.scene.model, data)
            n += any(contact.dist < 0.0 for contact in data.contact[: data.ncon])
    return n


def row_of(
    options: Options, case: str, spring_n_m: float, held: HeldForce, told: tuple[float, float, int]
) -> list[str]:
    """The cells of a case on a spring."""
    seconds, way_m, n_contacts = told
    off_n = np.abs(held.force_n - held.wanted_n)
    return [
        *(f"`{case}`", f"{spring_n_m:g}", f"{held.wanted_n:g}", str(options.seeds)),
        *(f"{seconds:.0f}", f"{way_m:.2f}", f"{held.force_in_band or 0.0:.1%}"),
        *(f"{held.slide_force_error_n or 0.0:.3f}", f"{off_n.max():.2f}"),
        *(f"{1e3 * held.slip_m.max():.2f}", f"{1e3 * held.lag_m.max():.2f}", str(n_contacts)),
    ]


def main(options: Options) -> None:
    """Run the sweeps and print the table."""
    rows = []
    for case in options.cases:
        setup: Setup | None = None
        for spring_n_m in options.springs_n_m:
            held, seconds, way_m, n_contacts = list[HeldForce](), 0.0, 0.0, 0
            for seed in range(options.seeds):
                parts = parts_of(options, case, spring_n_m, seed)
                setup = setup or build_setup(parts.scenario, parts.arm, parts.map_settings, probe=parts.probe)
                episode = make_episode(parts, setup)
                steps = list(episode.steps(parts.n_steps))
                held += [step.motion.held for step in steps if step.motion.held is not None]
                seconds += sum(slid_s(step) for step in steps)
                way_m += sum(step.motion.contact_path_m for step in steps)
                n_contacts += other_contacts(setup, steps)
            together = held_together(held)
            assert together is not None
            rows.append(row_of(options, case, spring_n_m, together, (seconds, way_m, n_contacts)))
    print(markdown_table(HEADER, rows))


def slid_s(step: Step) -> float:
    """For how long the probe slid in an action [s]."""
    motion = step.motion
    is_on = motion.phases[1:] == int(Phase.SWEEP)
    return float(np.diff(motion.time_s)[is_on].sum())


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        main(tyro.cli(Options))

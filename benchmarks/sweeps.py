"""Sensing along the way against stop and go, from campaigns of the study `sweeps`, and a picture of a sweep's trace.

Run it by `.venv/bin/python -m benchmarks.sweeps --help`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sim.comparison.estimates import mean_estimate
from sim.comparison.tables import interval_text
from sim.comparison.trial_groups import TrialGroup, load_groups
from sim.episode.episode import Episode
from sim.episode.setup import build_setup
from sim.episode.step import Step
from sim.pictures.figures import GRID
from sim.running.fields import config_of
from sim.running.parts import make_parts
from sim.running.run_episode import make_episode
from sim.tables import markdown_table

ROOT = Path(__file__).resolve().parents[1]
HEADER = (
    *("scenario", "planner", "sensing", "seeds", "got to 95 %", "procedure [s]", "of stop and go"),
    *("actions", "readings", "lift-offs", "tip path [m]"),
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print the table, or draw the picture."""

    campaign: tuple[Path, ...] = (Path("renders/sweeps"),)
    """Folders of campaigns."""
    trace: str | None = None
    """Scenario whose trace is drawn in place of the table."""
    seed: int = 0
    """Seed of that episode."""
    figure: Path = ROOT / "docs" / "figures" / "sweep.png"
    """Picture of the trace to write."""


def sensing_of(group: TrialGroup) -> str:
    """How a group senses."""
    return "sweep" if group.setting("sense") == "sweep" else f"stop, {group.setting('sensing_s'):g} s"


def table(groups: list[TrialGroup]) -> list[tuple[str, ...]]:
    """A row for each group, with the ratio of its mean time to that of stop and go in the same scenario and seeds."""
    rows = []
    for group in groups:
        scenario = group.setting("scenario")
        default = next(
            each
            for each in groups
            if each.setting("scenario") == scenario and sensing_of(each) == "stop, 2 s"
        )
        seconds = {
            each: dict(zip(each.seeds.tolist(), each.values("procedure_s"), strict=True))
            for each in (group, default)
        }
        shared = sorted(seconds[group].keys() & seconds[default].keys())
        ratio = np.mean([seconds[group][s] for s in shared]) / np.mean([seconds[default][s] for s in shared])
        estimate = mean_estimate(group.values("procedure_s"))
        is_there = np.isfinite(group.sensings_to_95())
        is_sweep = sensing_of(group) == "sweep"
        n = len(group.entries)
        readings = group.values("n_readings" if is_sweep else "n_sensings")
        lifts = group.values("n_lift_offs") if is_sweep else group.values("n_sensings") - 1
        rows.append(
            (
                *(scenario, group.setting("planner"), sensing_of(group), str(n), f"{is_there.sum()} of {n}"),
                f"{estimate.mean:.1f} {interval_text(estimate.interval, '{:.1f}')}",
                f"{ratio:.2f}",
                *(f"{each.mean():.1f}" for each in (group.values("n_sensings"), readings, lifts)),
                f"{group.values('tip_path_m').mean():.2f}",
            )
        )
    return rows


def draw(options: Options) -> None:
    """Draw the trace of an episode from above, coloured by the time of the procedure, with its readings."""
    parts = make_parts(
        config_of(
            scenario=options.trace, arm="none", motion="none", sense="sweep", steps=60, until_sensed=0.95,
            seed=options.seed, planner="find-and-outline-paths",
        )
    )  # fmt: skip
    episode = make_episode(parts, build_setup(parts.scenario, parts.arm, parts.map_settings))
    steps = list(episode.steps(parts.n_steps, **parts.stops))
    figure = Figure(figsize=(6.4, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    poses_mm = 1e3 * episode.setup.workspace.positions_m
    axes.scatter(poses_mm[::3, 0], poses_mm[::3, 1], s=1, color=GRID)
    for tumour in episode.truth.anatomy.tumours:
        corners_mm = 1e3 * tumour.vertices_m
        axes.scatter(corners_mm[:, 0], corners_mm[:, 1], s=1, color="0.6")
    time_s, tips_m, is_on, read_m = _trace(episode, steps)
    axes.plot(1e3 * tips_m[:, 0], 1e3 * tips_m[:, 1], color="0.8", lw=0.8, zorder=1)
    points = axes.scatter(*1e3 * tips_m[is_on, :2].T, c=time_s[is_on], s=6, cmap="viridis", zorder=2)
    axes.scatter(*1e3 * read_m[:, :2].T, s=22, facecolors="none", edgecolors="black", lw=0.7, zorder=3)
    figure.colorbar(points, label="time of the procedure [s]")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    options.figure.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.figure, dpi=120)
    sensed = steps[-1].sensed_fraction or 0.0
    counts = f"{len(steps)} actions, {len(read_m)} readings, {time_s[-1]:.1f} s"
    print(f"{options.trace}, seed {options.seed}: {counts}, {sensed:.0%} sensed")


def _trace(
    episode: Episode, steps: list[Step]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Times, tips, which of them are on the organ, and where readings were taken."""
    begins_s = np.concatenate([[0.0], np.cumsum([step.procedure_s for step in steps])])
    time_s = np.concatenate(
        [begin_s + step.motion.time_s for begin_s, step in zip(begins_s, steps, strict=False)]
    )
    tips_m = np.concatenate([step.motion.tips_m for step in steps])
    is_on = np.concatenate([step.motion.phases >= 3 for step in steps])
    read_m = np.concatenate(
        [step.sweep.T_world_readings[:, :3, 3] for step in steps if step.sweep is not None]
    )
    return time_s, tips_m, is_on, read_m


def main(options: Options) -> None:
    """Print the table, or draw the picture."""
    if options.trace is not None:
        draw(options)
        return
    print(markdown_table(HEADER, table(load_groups(list(options.campaign)))))


if __name__ == "__main__":
    main(tyro.cli(Options))

"""What each planner chooses on one seed, from above: `.venv/bin/python -m benchmarks.planner_pictures`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from planner import planner_names
from sim.episode.episode import Episode
from sim.episode.setup import build_setup
from sim.episode.step import Step
from sim.pictures.figures import BLUE, GRID, INK, MUTED, VERMILION
from sim.running.fields import config_of
from sim.running.parts import make_parts

_MM_PER_M = 1e3
_COLUMNS = 3
"""Panels beside each other."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Draw the episode of each planner."""

    scenario: str = "sphere"
    """Scenario of the episodes."""
    seed: int = 1001
    """Seed of the episodes."""
    steps: int = 40
    """Largest number of actions; an episode ends once 95 % was sensed."""
    out: Path = Path("docs/figures/planners.png")
    """The picture to write."""


def play(options: Options, planner: str) -> tuple[Episode, list[Step]]:
    """The episode of a planner with a free probe, and its steps."""
    parts = make_parts(config_of(scenario=options.scenario, planner=planner, seed=options.seed, arm="none"))
    setup = build_setup(parts.scenario, None, parts.map_settings)
    episode = Episode(
        setup, parts.planner, seed=parts.seed, map_settings=parts.map_settings, detail=parts.detail
    )
    return episode, list(episode.steps(options.steps, until_sensed=0.95))


def draw(axes: Axes, name: str, episode: Episode, steps: list[Step]) -> None:
    """Draw the footprints of the cones halfway down, numbered in order, with the true tumours."""
    for tumour in episode.truth.anatomy.tumours:
        low_m, high_m = tumour.bounds_m
        middle_mm = _MM_PER_M * (low_m + high_m)[:2] / 2
        radius_mm = _MM_PER_M * (high_m - low_m)[:2].max() / 2
        axes.add_patch(Circle((middle_mm[0], middle_mm[1]), radius_mm, color=INK, alpha=0.25, linewidth=0))
    workspace, cone = episode.setup.workspace, episode.setup.cone
    for step in steps:
        position_m, normal = workspace.positions_m[step.pose_index], workspace.normals[step.pose_index]
        middle_mm = _MM_PER_M * (position_m + 0.5 * cone.depth_m * normal)[:2]
        radius_mm = _MM_PER_M * 0.5 * cone.depth_m * math.tan(cone.half_angle_rad)
        colour = VERMILION if step.reading.is_occupied.any() else BLUE
        axes.add_patch(
            Circle((middle_mm[0], middle_mm[1]), radius_mm, fill=False, color=colour, linewidth=1.0)
        )
        axes.text(*middle_mm, str(step.step), color=colour, fontsize=7, ha="center", va="center")
    frame_outline(axes, workspace.positions_m)
    is_done = (steps[-1].sensed_fraction or 0.0) >= 0.95
    axes.set_title(
        f"{name}: {len(steps)} sensings" + ("" if is_done else ", not done"), fontsize=9, loc="left"
    )


def frame_outline(axes: Axes, positions_m: NDArray[np.float64]) -> None:
    """Set limits and labels in millimetres around the workspace."""
    low_mm, high_mm = _MM_PER_M * positions_m.min(axis=0)[:2], _MM_PER_M * positions_m.max(axis=0)[:2]
    axes.set(xlim=(low_mm[0] - 8, high_mm[0] + 8), ylim=(low_mm[1] - 8, high_mm[1] + 8), aspect="equal")
    axes.set_xlabel("x [mm]", fontsize=8, color=MUTED)
    axes.set_ylabel("y [mm]", fontsize=8, color=MUTED)
    axes.tick_params(labelsize=7, colors=MUTED)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)


def main(options: Options) -> None:
    """Draw a panel per planner and write the picture."""
    names = planner_names()
    n_rows = -(-len(names) // _COLUMNS)
    figure = Figure(figsize=(4.0 * _COLUMNS, 4.3 * n_rows), dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    with threadpool_limits(1):
        for place, name in enumerate(names, start=1):
            draw(figure.add_subplot(n_rows, _COLUMNS, place), name, *play(options, name))
    figure.suptitle(
        f"{options.scenario}, seed {options.seed}, from above: the cones halfway down in order, vermilion where the "
        "reading held tumour; the tumour in grey",
        fontsize=9,
        color=MUTED,
    )
    options.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.out)
    print(options.out)


if __name__ == "__main__":
    main(tyro.cli(Options))

"""Sensing along the way against stop and go on equal seeds: trials, their tables, and a picture of a sweep's trace.

Run it by `.venv/bin/python -m benchmarks.sweeps --help`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mapping.storage import replacing
from sim.comparison.estimates import mean_estimate, paired_estimate
from sim.comparison.tables import interval_text
from sim.episode.episode import Episode
from sim.episode.setup import build_setup
from sim.episode.step import Step
from sim.pictures.figures import GRID
from sim.running.fields import config_of
from sim.running.parts import make_parts
from sim.running.run_episode import make_episode
from sim.running.sweep import SWEEP
from sim.tables import markdown_table, nan_for_none

from .sweep_trials import BASE, CONTENDERS, TIMES_S, Plan, Row, rows_of, run_plan

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "sweeps.md"
CONTENDER = ("case", "arm", "planner", "sensing")
"""What tells a contender of a case from the others in a row of a trial."""
OURS = ("find-and-outline", "find-and-outline-paths")
"""Planners that are compared with each of the others."""
NAMES = ("case", "probe", "planner", "sensing", "seeds")
TO_95 = (*NAMES, "got to 95 %", "procedure [s]", "of stop and go", "readings", "lift-offs", "tip path [m]")
AGAINST = ("case", "probe", "planner", "against", "tip path [m]", "shorter", "procedure [s]", "less")
IN_TIME = (
    *NAMES,
    *(f"found, {time_s:g} s" for time_s in TIMES_S),
    *(f"AUPRC, {time_s:g} s" for time_s in TIMES_S),
    *("computing [s/s]",),
)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run trials, print their tables, or draw the picture."""

    trials: Path = Path("renders/sweeps/trials.jsonl")
    """File of the trials, a line each; those that it has are not run again."""
    run: tuple[str, ...] = ()
    """Cases to run: scenarios, or folders of $SOUNDING_DATA/livers. None to print the tables of what there is."""
    arm: str = "none"
    """What carries the probe in them: none, or an arm."""
    planners: tuple[str, ...] = ()
    """Planners of sweeps to run; by default all."""
    seeds: int = 6
    """Seeds to run, from 0 on."""
    minutes: float = 600.0
    """No further trial of a case begins after so long."""
    write: bool = False
    """Put the tables into docs/sweeps.md."""
    trace: str | None = None
    """Scenario whose trace is drawn in place of the tables."""
    seed: int = 0
    """Seed of that episode."""
    figure: Path = ROOT / "docs" / "figures" / "sweep.png"
    """Picture of the trace to write."""


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """The trials of a contender, by rising seed, and those of stop and go on the same seeds."""

    own: Sequence[Row]
    base: Sequence[Row]


def paired(rows: Sequence[Row]) -> list[Pairs]:
    """The trials of each contender on the seeds that stop and go has too, case by case, the free probe first."""
    groups: dict[tuple[str, ...], dict[int, Row]] = {}
    names = [(each.planner, each.sensing) for each in CONTENDERS]
    for row in rows:
        if (row["planner"], row["sensing"]) in names:
            groups.setdefault(tuple(row[name] for name in CONTENDER), {})[row["seed"]] = row
    kept = []
    for name, own in groups.items():
        base = groups.get((*name[:2], BASE.planner, BASE.sensing), {})
        seeds = sorted(own.keys() & base.keys())
        if seeds:
            kept.append(Pairs(own=[own[seed] for seed in seeds], base=[base[seed] for seed in seeds]))
    cases = list(dict.fromkeys(row["case"] for row in rows))

    def place(pairs: Pairs) -> tuple[int, bool, int]:
        case, arm, planner, sensing = (pairs.own[0][name] for name in CONTENDER)
        return cases.index(case), arm != "none", names.index((planner, sensing))

    return sorted(kept, key=place)


def named(group: Sequence[Row]) -> tuple[str, ...]:
    """The first cells of a row of both tables."""
    first = group[0]
    carrier = "free" if first["arm"] == "none" else "arm"
    return f"`{first['case']}`", carrier, first["planner"], first["sensing"], str(len(group))


def means(group: Sequence[Row], value: Callable[[Row], Any]) -> float:
    """The mean of a value over trials, those left out that have none."""
    values = np.array(nan_for_none(value(row) for row in group))
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def to_95(groups: Sequence[Pairs]) -> list[tuple[str, ...]]:
    """A row for each contender: what it took until 95 % was sensed, and the ratio of its mean time to stop and go's."""
    table = []
    for pairs in groups:
        group = pairs.own
        estimate = mean_estimate([row["procedure_s"] for row in group])
        ratio = estimate.mean / means(pairs.base, lambda row: row["procedure_s"])
        counts = (
            f"{means(group, lambda row, key=key: row[key]):{form}}"
            for key, form in (("n_readings", ".1f"), ("n_lift_offs", ".1f"), ("tip_path_m", ".2f"))
        )
        there = f"{sum(row['is_sensed'] for row in group)} of {len(group)}"
        time = f"{estimate.mean:.1f} {interval_text(estimate.interval, '{:.1f}')}"
        table.append((*named(group), there, time, f"{ratio:.2f}", *counts))
    return table


def against(groups: Sequence[Pairs]) -> list[tuple[str, ...]]:
    """A row for each of our planners of sweeps and each other planner: the differences seed by seed, ours first."""
    table = []
    for ours, other in product(groups, groups):
        names, others = ([each.own[0][name] for name in CONTENDER] for each in (ours, other))
        is_pair = names[2] in OURS and others[2] not in OURS and names[3] == others[3] == SWEEP
        if not is_pair or names[:2] != others[:2]:
            continue
        held = {row["seed"]: row for row in ours.own}
        both = [(held[row["seed"]], row) for row in other.own if row["seed"] in held]
        if not both:
            continue
        cells = []
        for key, form in (("tip_path_m", "{:.2f}"), ("procedure_s", "{:.1f}")):
            first, second = ([row[key] for row in rows] for rows in zip(*both, strict=True))
            estimate = paired_estimate(first, second, lower_is_better=True)
            difference = estimate.difference
            cells.append(f"{form.format(difference.mean)} {interval_text(difference.interval, form)}")
            cells.append(f"{estimate.n_wins} of {estimate.n}")
        case, carrier, planner, *_ = named(ours.own)
        table.append((case, carrier, planner, others[2], *cells))
    return table


def in_time(groups: Sequence[Pairs]) -> list[tuple[str, ...]]:
    """A row for each contender: lesions found and AUPRC at equal times, and computing for a second of procedure."""
    table = []
    for group in (pairs.own for pairs in groups):
        cells = []
        for time_s in TIMES_S:
            found, n = (
                sum(row["at"][f"{time_s:g}"][key] for row in group) for key in ("n_found", "n_lesions")
            )
            cells.append(f"{found} of {n}")
        for time_s in TIMES_S:
            cells.append(f"{means(group, lambda row, key=f'{time_s:g}': row['at'][key]['auprc']):.3f}")
        whole = [row["whole"] for row in group]
        computing = sum(row["computing_s"] for row in whole) / sum(row["procedure_s"] for row in whole)
        table.append((*named(group), *cells, f"{computing:.2f}"))
    return table


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


def run(options: Options) -> None:
    """Run the trials of all cases that are asked for."""
    contenders = [
        each
        for each in CONTENDERS
        if each.sense == "stop" or not options.planners or each.planner in options.planners
    ]
    for case in options.run:
        plan = Plan(case=case, arm=options.arm, contenders=contenders, seeds=range(options.seeds))
        run_plan(plan, options.trials, until_s=60.0 * options.minutes)


def main(options: Options) -> None:
    """Run trials and print their tables, or draw the picture."""
    if options.trace is not None:
        draw(options)
        return
    run(options)
    groups = paired(rows_of([options.trials]))
    tables = [
        markdown_table(TO_95, to_95(groups)),
        markdown_table(IN_TIME, in_time(groups)),
        markdown_table(AGAINST, against(groups)),
    ]
    print("\n\n".join(tables))
    if options.write:
        write(tables)


def write(tables: Sequence[str]) -> None:
    """Put each table between its marks on the page about sweeps."""
    page = PAGE.read_text(encoding="utf-8")
    for number, table in enumerate(tables, start=1):
        begin, end = (f"<!-- table {number} of sweeps: {mark} -->" for mark in ("begin", "end"))
        before, rest = page.split(begin)
        page = f"{before}{begin}\n{table}\n{end}{rest.split(end)[1]}"
    with replacing(PAGE) as file:
        file.write(page.encode())


if __name__ == "__main__":
    main(tyro.cli(Options))

"""Scores along the way, from campaigns: `.venv/bin/python -m benchmarks.planner_scores FOLDER ... --at 30 50`.

The scores are the AUPRC after some numbers of actions, which `sounding compare` draws as a curve, the most sensings
that a trial took, and the time to plan one action.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray

from sim.comparison.trial_groups import TrialGroup, load_groups
from sim.tables import markdown_table

SENSED = 0.95


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print a row per case and contender."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of campaigns."""
    at: tuple[int, ...] = (30, 50)
    """Numbers of actions after which AUPRC is reported."""
    n_seeds: int | None = None
    """Look only at seeds below this."""


def row(group: TrialGroup, at: tuple[int, ...]) -> list[str]:
    """The line of a group in the table."""
    curve, sensings = group.curve("auprc"), group.sensings_to_95()
    plan_s = sum(entry["timings"]["plan_s"] for entry in group.entries)
    plan_ms = 1e3 * plan_s / group.values("n_sensings").sum()
    cells = []
    for n in at:
        has_map = group.n_steps >= n and curve.shape[1] >= n and np.isfinite(curve[:, n - 1]).all()
        is_fixed = all(
            group.setting(name) is None for name in ("until_sensed", "until_confident", "miss_cost")
        )
        values = curve[:, n - 1] if has_map and is_fixed else np.empty(0)
        cells.append(f"{values.mean():.3f} ± {values.std(ddof=1):.3f}" if values.size > 1 else "-")
        cells.append(split(values, group.curve("sensed_fraction")[:, n - 1]) if values.size > 1 else "-")
    most = f"{sensings.max():.0f}" if np.isfinite(sensings).all() else "never"
    return [group.case, group.contender, str(len(group.entries)), *cells, most, f"{plan_ms:.1f}"]


def split(values: NDArray[np.float64], sensed_fraction: NDArray[np.float64]) -> str:
    """The means over trials that sensed `SENSED` of the tumours or more, and over the others, with their numbers."""
    is_sensed = sensed_fraction >= SENSED
    parts = [values[mask] for mask in (is_sensed, ~is_sensed)]
    return " / ".join(f"{part.mean():.3f} ({part.size})" if part.size else "- (0)" for part in parts)


def main(options: Options) -> None:
    """Print the table."""
    seeds = None if options.n_seeds is None else range(options.n_seeds)
    head = (
        "case",
        "contender",
        "trials",
        *(head for n in options.at for head in (f"AUPRC at {n}", f"at {n}, 95 % sensed / less")),
        "most sensings",
        "plan [ms]",
    )
    groups = [group for group in load_groups(list(options.folders), seeds=seeds) if group.entries]
    print(markdown_table(head, [row(group, options.at) for group in groups]))


if __name__ == "__main__":
    main(tyro.cli(Options))

"""The figures of a comparison: bars, curves over the sensing actions, precision against recall."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from sim.campaign.trial_result import RECALL_LEVELS
from sim.pictures.figures import BLUE, INK, MUTED, VERMILION, new_figure, save, set_title

from .comparison import SENSINGS, Comparison, Score, horizon_of, measured
from .estimates import reached_shares, spread_of
from .trial_groups import TrialGroup

COLOURS = (VERMILION, BLUE, "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Colours of Okabe and Ito's palette, one for each contender."""
LEAST_WIDTH_IN = 5.2
"""Least width of a bar chart: a narrower one has no room for its title."""
JITTER = 0.16
"""Dots of trials lie this far to either side of the middle of their bar [bar spacings]."""


def draw_sensings(path: Path, comparison: Comparison, case: str) -> bool:
    """Write a bar chart of the sensings to 95 %, with a dot per trial, and return whether there was any to draw."""
    groups = [g for g in comparison.groups_of(case) if comparison.score(case, g.contender, SENSINGS.key)]
    if not groups:
        return False
    horizon = horizon_of(groups)
    margins_in = (0.72, 0.22, 0.85, 0.52)
    figure, axes = new_figure(
        width_in=max(2.2 + 1.5 * len(groups), LEAST_WIDTH_IN), height_in=4.6, margins_in=margins_in
    )
    labels = []
    for place, group in enumerate(groups):
        score = comparison.score(case, group.contender, SENSINGS.key)
        assert score is not None
        _draw_bar(axes, place, score, measured(group, SENSINGS, horizon), COLOURS[place % len(COLOURS)])
        labels.append(_bar_label(score))
    axes.set_xticks(range(len(groups)), labels)
    axes.set(ylabel="sensing actions to 95 %", xlim=(-0.6, len(groups) - 0.4), ylim=(0, None))
    axes.grid(visible=False, axis="x")
    if np.isfinite(horizon):
        axes.axhline(horizon, color=MUTED, linestyle=(0, (4, 3)), linewidth=1.0)
    _title(axes, f"Until 95 % was sensed: {case}", groups)
    save(figure, path)
    return True


def _draw_bar(axes: Axes, place: int, score: Score, values: NDArray[np.float64], colour: str) -> None:
    estimate = score.estimate
    axes.bar(place, estimate.mean, width=0.62, color=colour, alpha=0.28)
    spread = np.linspace(-JITTER, JITTER, len(values)) if len(values) > 1 else np.zeros(1)
    # In the order of seeds, dots of a trend would make a slope.
    order = np.random.default_rng(0).permutation(len(values))
    axes.plot(place + spread[order], values, "o", color=colour, markersize=3.5, alpha=0.75, markeredgewidth=0)
    if np.isfinite(estimate.interval[0]):
        low, high = estimate.interval
        axes.errorbar(
            place + 0.25,
            estimate.mean,
            yerr=[[estimate.mean - low], [high - estimate.mean]],
            color=INK,
            capsize=4,
            linewidth=1.6,
        )


def _bar_label(score: Score) -> str:
    """The name, the mean and the number of trials that never got there, which would lie among the dots elsewhere."""
    never = f", {score.n_never} never" if score.n_never else ""
    return f"{_wrapped(score.contender)}\n$\\bf{{{score.estimate.mean:.1f}}}${never}"


def draw_reached(path: Path, comparison: Comparison, case: str) -> bool:
    """Write the share of trials that had got to 95 % after each action, and return whether there was any to draw."""
    groups = [g for g in comparison.groups_of(case) if comparison.score(case, g.contender, SENSINGS.key)]
    if not groups:
        return False
    figure, axes = new_figure(width_in=6.4, height_in=4.2)
    last = max(group.n_steps for group in groups)
    for index, group in enumerate(groups):
        x, y = reached_shares(group.sensings_to_95())
        axes.step(
            x, y, where="post", color=COLOURS[index % len(COLOURS)], linewidth=2.2, label=group.contender
        )
    axes.set(
        xscale="log", xlabel="sensing actions", ylabel="share of trials with 95 % sensed", ylim=(0, 1.02)
    )
    axes.set_xlim(1, max(last, 2) if last < 1000 else None)
    axes.legend(frameon=False, fontsize=9, loc="upper left")
    _title(axes, f"Trials that got to 95 %: {case}", groups)
    save(figure, path)
    return True


def draw_curves(path: Path, comparison: Comparison, case: str) -> bool:
    """Write mean and deviation of the AUPRC after each action, and return whether there was any to draw."""
    groups = [g for g in comparison.groups_of(case) if comparison.score(case, g.contender, "auprc")]
    if not groups:
        return False
    figure, axes = new_figure(width_in=6.4, height_in=4.4)
    for index, group in enumerate(groups):
        curves = group.curve("auprc")
        actions = np.arange(1, curves.shape[1] + 1)
        _draw_band(axes, actions, curves, COLOURS[index % len(COLOURS)], group.contender)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="sensing actions", ylabel="AUPRC, mean ± standard deviation", ylim=(0, 1.02))
    axes.legend(frameon=False, fontsize=9, loc="lower right")
    _title(axes, f"Area under precision-recall: {case}", groups)
    save(figure, path)
    return True


def draw_precision(path: Path, comparison: Comparison, case: str) -> bool:
    """Write mean and deviation of the final maps' precision at each recall, and return whether there was any."""
    groups = [g for g in comparison.groups_of(case) if comparison.score(case, g.contender, "auprc")]
    if not groups:
        return False
    figure, axes = new_figure(width_in=5.4, height_in=4.6)
    for index, group in enumerate(groups):
        curves = group.curve("precision")
        _draw_band(axes, RECALL_LEVELS, curves, COLOURS[index % len(COLOURS)], group.contender)
    points = groups[0].values("n_occupied") / groups[0].values("n_points")
    axes.axhline(
        float(points.mean()), color=MUTED, linestyle=(0, (4, 3)), linewidth=1.2, label="uninformed map"
    )
    axes.set(xlabel="recall", ylabel="precision, mean ± standard deviation", xlim=(0, 1.02), ylim=(0, 1.02))
    axes.legend(frameon=False, fontsize=9, loc="lower left")
    _title(axes, f"Final maps: {case}", groups)
    save(figure, path)
    return True


def _draw_band(
    axes: Axes, x: NDArray[np.float64], curves: NDArray[np.float64], colour: str, label: str
) -> None:
    mean, low, high = spread_of(curves)
    axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(x, mean, color=colour, linewidth=2.2, label=label)


def _title(axes: Axes, text: str, groups: list[TrialGroup]) -> None:
    counts = sorted({len(group.entries) for group in groups})
    of = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    set_title(axes, f"{text} ({of} trials)", size_pt=11.0)


def _wrapped(text: str) -> str:
    return text.replace("-", "-\n", 1) if len(text) > 14 else text

"""The figures about lesions: the share mapped over the actions, and found against false findings over the threshold."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import MaxNLocator

from sim.pictures.figures import new_figure, save, set_title

from ..figures import COLOURS
from .tables import scores_of

if TYPE_CHECKING:
    from ..comparison import Comparison


def draw_mapped(path: Path, comparison: Comparison, case: str) -> bool:
    """Write the share of lesions mapped after each action, and return whether there was any to draw."""
    scores = scores_of(comparison, case)
    if not scores:
        return False
    figure, axes = new_figure(width_in=6.4, height_in=4.4)
    for index, score in enumerate(scores):
        colour = COLOURS[index % len(COLOURS)]
        ends = np.array([share.interval for share in score.mapped])
        axes.fill_between(
            score.actions, ends[:, 0], ends[:, 1], step="post", color=colour, alpha=0.15, linewidth=0
        )
        mapped, seen = ([share.share for share in shares] for shares in (score.mapped, score.seen))
        axes.step(
            score.actions,
            mapped,
            where="post",
            color=colour,
            linewidth=2.2,
            label=f"{score.contender}: mapped",
        )
        axes.step(
            score.actions,
            seen,
            where="post",
            color=colour,
            linewidth=1.2,
            linestyle=(0, (4, 3)),
            label="seen",
        )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="sensing actions", ylabel="share of lesions, 95 % interval", ylim=(0, 1.02))
    axes.set_xlim(0, None)
    axes.legend(frameon=False, fontsize=9, loc="best")
    set_title(axes, f"Lesions mapped, and those seen: {case} ({scores[0].mapped[0].n} lesions)", size_pt=11.0)
    save(figure, path)
    return True


def draw_free_response(path: Path, comparison: Comparison, case: str) -> bool:
    """Write the share of lesions found against false findings a run, and return whether there was any to draw."""
    scores = [score for score in scores_of(comparison, case) if score.response is not None]
    if not scores:
        return False
    figure, axes = new_figure(width_in=6.4, height_in=4.4)
    for index, score in enumerate(scores):
        response, colour = score.response, COLOURS[index % len(COLOURS)]
        assert response is not None
        found = [share.share for share in response.found]
        axes.plot(
            response.false_per_run,
            found,
            "o-",
            color=colour,
            linewidth=2.0,
            markersize=3.5,
            label=score.contender,
        )
        own = response.found[response.own]
        at = float(response.false_per_run[response.own])
        if np.isfinite(own.interval[0]):
            axes.plot([at, at], own.interval, color=colour, linewidth=1.2)
        axes.plot(at, own.share, "o", color=colour, markersize=8)
    axes.set(xlabel="false findings a run", ylabel="share of lesions found", ylim=(0, 1.02))
    axes.legend(frameon=False, fontsize=9, loc="best")
    set_title(
        axes,
        f"Free response over the map's threshold: {case} (large dots: its own)",
        size_pt=11.0,
    )
    save(figure, path)
    return True

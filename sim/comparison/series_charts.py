"""Charts of several contenders: curves with their spread, shares over a logarithmic axis, intervals on one line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from sim.report.charts import QUARTERS, Numbers, Plot, count_ticks, svg_text, x_axis, y_axis

N_COLOURS = 7
"""Colours of the style sheet, c0 to c6; with more contenders they repeat."""
MOST_POINTS = 400
"""Most points of a curve that is drawn."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """The curve of a contender."""

    name: str
    index: int
    """Place of the contender among all, which decides about the colour."""
    x: Numbers
    """Places across, shape (K,)."""
    middle: Numbers
    """Heights of the curve, shape (K,)."""
    low: Numbers | None = None
    """Lower edge of the spread, shape (K,); None where no spread is drawn."""
    high: Numbers | None = None
    """Upper edge of the spread, shape (K,); None where no spread is drawn."""
    is_step: bool = False
    """Whether each height is held until the next place."""

    @property
    def colour(self) -> str:
        """The class of the curve's colour."""
        return f"c{self.index % N_COLOURS}"


def series_chart(series: Sequence[Series], *, label: str, is_log: bool = False, is_unit: bool = False) -> str:
    """A chart of curves over the sensing actions, or over the unit interval, with heights from 0 to 1.

    Args:
        series: The curves.
        label: What is drawn, for those who cannot see it.
        is_log: Whether the actions stand on a logarithmic axis.
        is_unit: Whether the places across run from 0 to 1 too.
    """
    last = max(float(each.x[-1]) for each in series)
    low = math.log10(float(min(each.x[0] for each in series))) if is_log else 0.0
    high = max(math.log10(last) if is_log else last, low + 1e-9)
    end = 1.0 if is_unit else high * 1.01
    plot = Plot(x_range=(low, end), y_range=(0.0, 1.0), width=380.0, height=250.0)
    ticks, texts = (QUARTERS if is_unit else count_ticks(int(last))), None
    if is_log:
        ticks = _decades(low, high)
        texts = [f"{10**tick:g}" for tick in ticks]
    body = [y_axis(plot, QUARTERS, is_percent=False), x_axis(plot, ticks, texts)]
    body += [_band(plot, each, is_log=is_log) for each in series if each.low is not None]
    body += [_curve(plot, each, is_log=is_log) for each in series]
    return svg_text(plot, label, body)


def strip(
    mean: float, interval: tuple[float, float], span: tuple[float, float], *, colour: str, zero: bool = False
) -> str:
    """A mean and its interval on a line that all rows of a table share.

    Args:
        mean: Where the dot lies.
        interval: Ends of the bar; NaN for no bar.
        span: Ends of the line.
        colour: Class of the colour.
        zero: Whether 0 is marked.
    """
    plot = Plot(
        x_range=span, y_range=(0.0, 1.0), width=180.0, height=20.0, left=4.0, right=4.0, top=0.0, bottom=0.0
    )
    body = ['<line class="grid" x1="4" x2="176" y1="10" y2="10"/>']
    if zero and span[0] <= 0 <= span[1]:
        body.append(f'<line class="target" x1="{plot.x(0):.1f}" x2="{plot.x(0):.1f}" y1="1" y2="19"/>')
    if all(math.isfinite(end) for end in interval):
        a, b = (plot.x(end) for end in interval)
        body.append(f'<line class="bar {colour}" x1="{a:.1f}" x2="{b:.1f}" y1="10" y2="10"/>')
    body.append(f'<circle class="dot {colour}" cx="{plot.x(mean):.1f}" cy="10" r="4"/>')
    return svg_text(plot, f"mean {mean:.3g}", body, 'class="strip"')


def span_of(
    means: Sequence[float], intervals: Sequence[tuple[float, float]], *, from_zero: bool
) -> tuple[float, float]:
    """The ends of a line that holds all means and intervals."""
    ends = [*means, *(end for interval in intervals for end in interval if math.isfinite(end))]
    low, high = (min(0.0, *ends), max(0.0, *ends)) if from_zero else (min(ends), max(ends))
    margin = 0.04 * (high - low) or max(abs(high), 1.0) * 0.04
    return low - (0.0 if from_zero and low == 0 else margin), high + margin


def legend(names: Sequence[str]) -> str:
    """The names of the contenders with their colours."""
    items = "".join(
        f'<span><i class="c{i % N_COLOURS}"></i>{escape(name)}</span>' for i, name in enumerate(names)
    )
    return f'<p class="key">{items}</p>'


def _curve(plot: Plot, each: Series, *, is_log: bool) -> str:
    points = _points(plot, each, each.middle, is_log=is_log)
    return f'<polyline class="line {each.colour}" points="{points}"><title>{escape(each.name)}</title></polyline>'


def _band(plot: Plot, each: Series, *, is_log: bool) -> str:
    assert each.low is not None
    assert each.high is not None
    there = _points(plot, each, each.high, is_log=is_log)
    back = " ".join(reversed(_points(plot, each, each.low, is_log=is_log).split()))
    return f'<polygon class="area {each.colour}" points="{there} {back}"/>'


def _points(plot: Plot, each: Series, heights: Numbers, *, is_log: bool) -> str:
    chosen = np.unique(np.linspace(0, len(each.x) - 1, min(len(each.x), MOST_POINTS)).round().astype(int))
    if each.is_step:
        chosen = np.arange(len(each.x))
    places = [plot.x(math.log10(each.x[i]) if is_log else float(each.x[i])) for i in chosen]
    corners, before = [], None
    for x, height in zip(places, heights[chosen], strict=True):
        y = plot.y(float(height))
        if each.is_step and before is not None:
            corners.append(f"{x:.1f},{before:.1f}")
        corners.append(f"{x:.1f},{y:.1f}")
        before = y
    return " ".join(corners)


def _decades(low: float, high: float) -> list[float]:
    ticks = [
        math.log10(step) + power
        for power in range(math.floor(low), math.ceil(high) + 1)
        for step in (1, 2, 5)
    ]
    kept = [tick for tick in ticks if low - 1e-9 <= tick <= high + 1e-9]
    return kept if len(kept) <= 8 else [tick for tick in kept if abs(tick - round(tick)) < 1e-9]

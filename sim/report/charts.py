"""Charts as SVG text: they need no script to be read, and carry their points so that a script can follow them.

Colours are classes of the page's style sheet, so that one chart serves light and dark.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]
LOG_FROM = 30.0
"""Positive values that span more than this factor are drawn on a logarithmic axis."""
MOST_HOVERED = 60
"""Most points of a curve whose values are told to whoever points at it."""
QUARTERS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Ticks of an axis from 0 to 1."""


@dataclass(frozen=True, kw_only=True)
class Plot:
    """The plane of a chart: the ranges of its data, and where they lie in the picture."""

    x_range: tuple[float, float]
    y_range: tuple[float, float]
    is_log: bool = False
    width: float = 380.0
    height: float = 150.0
    left: float = 38.0
    right: float = 12.0
    top: float = 10.0
    bottom: float = 26.0

    def x(self, value: float) -> float:
        """The place of a value across the picture."""
        low, high = self.x_range
        return self.left + (value - low) / (high - low) * (self.width - self.left - self.right)

    def y(self, value: float) -> float:
        """The place of a value down the picture; values beyond the range lie on its edge."""
        low, high = self.y_range
        if self.is_log:
            value, low, high = (math.log10(max(v, 1e-300)) for v in (value, low, high))
        share = min(max((value - low) / (high - low), 0.0), 1.0)
        return self.height - self.bottom - share * (self.height - self.top - self.bottom)


def progress_chart(
    name: str, curves: Sequence[Numbers], *, colours: Sequence[str], label: str, digits: int = 2,
    target: float | None = None, y_top: float | None = None, is_percent: bool = False, has_dots: bool = False,
    height: float = 150.0,
) -> str:  # fmt: skip
    """One curve or more over the sensing actions, from 1 on, with what a slider needs to follow them.

    Args:
        name: The name by which the page knows the chart.
        curves: One value per action for each curve, shapes (T,); NaN where there is none.
        colours: Class of the colour of each: truth, map, probe, ink, or c0 to c6.
        label: What is drawn, for those who cannot see it.
        digits: Decimals of the values as text.
        target: A value to mark.
        y_top: Upper end of the axis; by default what the values need.
        is_percent: Whether values are written as percentages.
        has_dots: Whether dots without a line are drawn, where an action has nothing to do with the one before.
        height: Height of the chart, whose width is 380.
    """
    finite = np.concatenate([values[np.isfinite(values)] for values in curves])
    if not finite.size:
        return ""
    n_actions = max(map(len, curves))
    plot, ticks = _plane(n_actions, finite, y_top)
    plot = replace(plot, height=height)
    body = [y_axis(plot, ticks, is_percent), x_axis(plot, count_ticks(n_actions))]
    if target is not None:
        y = plot.y(target)
        body.append(
            f'<line class="target" x1="{plot.left}" x2="{plot.width - plot.right}" y1="{y:.1f}" y2="{y:.1f}"/>'
        )
    followed, marks = [], [f'<line class="cursor" y1="{plot.top}" y2="{plot.height - plot.bottom}"/>']
    for values, colour in zip(curves, colours, strict=True):
        points = [[round(plot.x(i + 1), 1), round(plot.y(v), 1)] if np.isfinite(v) else None
                  for i, v in enumerate(values)]  # fmt: skip
        body += _drawn([point for point in points if point], colour, has_dots=has_dots)
        marks.append(f'<circle class="now {colour}" r="4.5"/>')
        followed.append({"points": points, "texts": [_text(value, digits, is_percent) for value in values]})
    data = escape(json.dumps(followed, separators=(",", ":")), quote=True)
    return svg_text(plot, label, [*body, *marks], f'data-chart="{name}" data-follow="{data}"')


def _drawn(points: Sequence[Sequence[float]], colour: str, *, has_dots: bool) -> list[str]:
    """A line through the points, dots at them where they are few, or dots alone."""
    if has_dots or len(points) <= 60:
        radius = 2.2 if has_dots else 1.8
        dots = [f'<circle class="dot {colour}" cx="{x}" cy="{y}" r="{radius}"/>' for x, y in points]
    else:
        dots = []
    line = f'<polyline class="line {colour}" points="{" ".join(f"{x},{y}" for x, y in points)}"/>'
    return dots if has_dots else [line, *dots]


def curve_chart(
    x: Numbers, y: Numbers, *, colour: str, label: str, level: float | None = None, level_text: str = ""
) -> str:
    """A curve in the unit square, with the area below it tinted.

    Args:
        x: Rising values across, shape (K,).
        y: Values up, shape (K,).
        colour: Class of its colour.
        label: What is drawn.
        level: A height to mark.
        level_text: What the mark says.
    """
    plot = _unit_square()
    path = " ".join(f"{plot.x(a):.1f},{plot.y(b):.1f}" for a, b in _steps(x, y))
    foot, first, last = plot.y(0.0), plot.x(float(x[0])), plot.x(float(x[-1]))
    body = [y_axis(plot, QUARTERS, False), x_axis(plot, QUARTERS)]
    body.append(
        f'<polygon class="area {colour}" points="{first:.1f},{foot:.1f} {path} {last:.1f},{foot:.1f}"/>'
    )
    body.append(f'<polyline class="line {colour}" points="{path}"/>')
    if level is not None:
        at = plot.y(level)
        body.append(
            f'<line class="target" x1="{plot.left}" x2="{plot.width - plot.right}" y1="{at:.1f}" y2="{at:.1f}"/>'
            f'<text class="note" x="{plot.left + 6}" y="{at - 5:.1f}">{escape(level_text)}</text>'
        )
    shown = np.unique(np.linspace(0, len(x) - 1, min(len(x), MOST_HOVERED)).round().astype(int))
    hovered = {
        "points": [[round(plot.x(float(x[i])), 1), round(plot.y(float(y[i])), 1)] for i in shown],
        "texts": [f"recall {x[i]:.2f}: precision {y[i]:.2f}" for i in shown],
    }
    data = escape(json.dumps(hovered, separators=(",", ":")), quote=True)
    return svg_text(plot, label, body, f'data-hover="{data}"')


def reliability_chart(predicted: Numbers, observed: Numbers, counts: Numbers, *, label: str) -> str:
    """Observed share against predicted probability, with a dot per bin whose area grows with the number of points.

    Args:
        predicted: Mean probability of each bin, shape (B,).
        observed: Share of tumour among its points, shape (B,).
        counts: Number of its points, shape (B,).
        label: What is drawn.
    """
    plot = _unit_square()
    body = [y_axis(plot, QUARTERS, False), x_axis(plot, QUARTERS)]
    body.append(f'<line class="target" x1="{plot.x(0)}" y1="{plot.y(0)}" x2="{plot.x(1)}" y2="{plot.y(1)}"/>')
    line = " ".join(f"{plot.x(p):.1f},{plot.y(o):.1f}" for p, o in zip(predicted, observed, strict=True))
    body.append(f'<polyline class="line map thin" points="{line}"/>')
    for p, o, n in zip(predicted, observed, counts, strict=True):
        radius = 2.5 + 1.1 * math.log10(max(n, 1))
        title = f"predicted {p:.2f}, observed {o:.2f}, {int(n):,} points"
        body.append(
            f'<circle class="dot map" cx="{plot.x(p):.1f}" cy="{plot.y(o):.1f}" r="{radius:.1f}"><title>{title}</title>'
            "</circle>"
        )
    return svg_text(plot, label, body)


def reliability(
    probability: Numbers, truth: NDArray[np.bool_], n_bins: int = 10
) -> tuple[Numbers, Numbers, Numbers]:
    """The mean probability, share of tumour and number of points of each bin of equal width that is not empty."""
    bins = np.minimum((probability * n_bins).astype(int), n_bins - 1)
    counts = np.bincount(bins, minlength=n_bins).astype(np.float64)
    kept = counts > 0
    predicted = np.bincount(bins, probability, minlength=n_bins)[kept] / counts[kept]
    observed = np.bincount(bins, truth, minlength=n_bins)[kept] / counts[kept]
    return predicted, observed, counts[kept]


def _plane(n_actions: int, finite: Numbers, y_top: float | None) -> tuple[Plot, Sequence[float]]:
    low, high = float(finite.min()), float(finite.max())
    x_range = (0.0, max(n_actions, 1) * 1.02)
    if y_top is None and low > 0 and high / low > LOG_FROM:
        decades = (math.floor(math.log10(low)), math.ceil(math.log10(high)))
        first = max(decades[0], decades[1] - 6)
        stride = max(1, math.ceil((decades[1] - first) / 4))
        ticks = [10.0**d for d in range(decades[1], first - 1, -stride)]
        return Plot(x_range=x_range, y_range=(10.0**first, 10.0 ** decades[1]), is_log=True), ticks
    top = y_top if y_top is not None else (nice(high) if high > 0 else 1.0)
    return Plot(x_range=x_range, y_range=(0.0, top)), np.linspace(0.0, top, 3).tolist()


def nice(value: float) -> float:
    """The next of 1, 2, 4, 5, 10 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 4.0, 5.0, 10.0) if step * power >= value * (1 - 1e-9))


def _unit_square() -> Plot:
    return Plot(x_range=(0.0, 1.0), y_range=(0.0, 1.0), width=540.0, height=380.0)


def count_ticks(n: int) -> list[float]:
    """At most seven evenly spaced whole numbers from 0 to n."""
    step = next(s * 10**p for p in range(6) for s in (1, 2, 5) if n / (s * 10**p) <= 6)
    return [float(tick) for tick in range(0, n + 1, step)]


def y_axis(plot: Plot, ticks: Sequence[float], is_percent: bool) -> str:
    """The numbers beside a chart, with a line across it for each."""
    parts = []
    for tick in ticks:
        y = plot.y(tick)
        text = f"{tick:.0%}" if is_percent else f"{tick:.3g}"
        if plot.is_log:
            text = f'10<tspan dy="-4" class="power">{round(math.log10(tick))}</tspan>'
        parts.append(
            f'<line class="grid" x1="{plot.left}" x2="{plot.width - plot.right}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text class="tick" x="{plot.left - 6}" y="{y + 3.5:.1f}" text-anchor="end">{text}</text>'
        )
    return "".join(parts)


def x_axis(plot: Plot, ticks: Sequence[float], texts: Sequence[str] | None = None) -> str:
    """The numbers below a chart, or texts in their place where these are given."""
    texts = texts or [f"{tick:g}" for tick in ticks]
    return "".join(
        f'<text class="tick" x="{plot.x(tick):.1f}" y="{plot.height - plot.bottom + 15:.1f}" '
        f'text-anchor="middle">{text}</text>'
        for tick, text in zip(ticks, texts, strict=True)
    )


def svg_text(plot: Plot, label: str, body: Sequence[str], attributes: str = "") -> str:
    """A chart of some elements, with a label for those who cannot see it."""
    return (
        f'<svg viewBox="0 0 {plot.width:g} {plot.height:g}" role="img" aria-label="{escape(label, quote=True)}" '
        f"{attributes}>{''.join(body)}</svg>"
    )


def _steps(x: Numbers, y: Numbers) -> list[tuple[float, float]]:
    """The corners of a curve of steps, each height held back to the place before; as many as can be told apart."""
    chosen = np.unique(np.concatenate([[0, len(x) - 1], np.flatnonzero(np.diff(np.round(x * 500))) + 1]))
    corners = [(float(x[chosen[0]]), float(y[chosen[0]]))]
    for i in chosen[1:]:
        corners += [(corners[-1][0], float(y[i])), (float(x[i]), float(y[i]))]
    return corners


def _text(value: float, digits: int, is_percent: bool) -> str:
    if not np.isfinite(value):
        return "–"
    if is_percent:
        return f"{value:.1%}"
    return f"{value:.{digits}f}" if value == 0 or abs(value) >= 10.0**-digits else f"{value:.1e}"

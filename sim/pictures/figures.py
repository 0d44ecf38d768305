"""The curves drawn at the end of a run: progress over the sensing actions, and precision against recall.

Every function goes from arrays to a file and touches no global state of matplotlib. The colours are of Okabe
and Ito's palette, which people with the common forms of colour blindness can tell apart.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from sim.colours import MAP, TARGET, TARGET_MAP, TRUTH
from sim.episode.measures import SENSED_GOAL

BLUE, VERMILION, PURPLE, AMBER = MAP, TRUTH, TARGET, TARGET_MAP
INK = "#222222"
MUTED = "#767676"
GRID = "#E6E6E6"
DPI = 150
"""Dots per inch of every figure."""
TITLE_PT, LEAST_TITLE_PT = 12.0, 7.0
"""Size of a title's letters, and the least to which they are made smaller where it does not fit [points]."""
TITLE_LINES = 2
"""Most lines of a title."""
LINE_SPACING = 1.25
"""Distance between two lines of a title, in sizes of its letters."""
Margins = tuple[float, float, float, float]
"""Room left, right, below and above a pair of axes [inch]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TargetCurves:
    """What the figures show of a second class that is mapped beside the tumours."""

    name: str
    """What it is called."""
    auprc: ArrayLike
    """AUPRC of its map after each action, shape (T,); NaN where it is not defined."""
    sensed_fraction: ArrayLike
    """Share of its volume sensed after each action, shape (T,)."""
    recall: ArrayLike = ()
    """Recall along the precision-recall curve of its final map, shape (K,); empty where that is not defined."""
    precision: ArrayLike = ()
    """Precision along it, shape (K,)."""


def draw_precision_recall(
    path: Path,
    *,
    recall: ArrayLike,
    precision: ArrayLike,
    auprc: float | None,
    prevalence: float,
    target: TargetCurves | None = None,
) -> None:
    """Write the precision-recall curve of the final map as a PNG.

    Args:
        path: The file to write.
        recall: Recall along the curve, shape (K,).
        precision: Precision along the curve, shape (K,).
        auprc: Area under the curve; None where the curve is not defined, since there is no tumour.
        prevalence: Share of tumour among the scored points, which is the precision of an uninformed map.
        target: The second class, whose curve is drawn as well; None where there is none.
    """
    figure, axes = new_figure(width_in=5.2, height_in=4.6)
    axes.set(xlabel="recall", ylabel="precision", xlim=(0, 1.02), ylim=(0, 1.02))
    title = "Precision and recall of the final map"
    if auprc is not None:
        _draw_ranking(axes, *_by_rising_recall(recall, precision), auprc)
        _draw_prevalence(axes, prevalence)
        title = f"{title}: area {auprc:.2f}"
    elif target is None:
        _note(axes, "No tumour in this organ:\nprecision and recall are not defined.")
    if target is not None:
        title = "Precision and recall of the final maps"
        _draw_target_ranking(axes, target)
    set_title(axes, title)
    save(figure, path)


def draw_progress(
    path: Path, *, auprc: ArrayLike, sensed_fraction: ArrayLike, target: TargetCurves | None = None
) -> None:
    """Write AUPRC and sensed fraction against the number of sensing actions as a PNG.

    Args:
        path: The file to write.
        auprc: AUPRC after each action, shape (T,); NaN where it is not defined.
        sensed_fraction: Share of the tumour volume sensed after each action, shape (T,); NaN without tumours.
        target: The second class, whose curves are drawn as well; None where there is none.
    """
    figure, axes = new_figure(width_in=6.8, height_in=4.2)
    sensed, ranked = (np.asarray(values, dtype=np.float64) for values in (sensed_fraction, auprc))
    axes.set(xlabel="sensing actions", ylim=(0, 1.02), xlim=(0, max(len(sensed), 1) * 1.02))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    set_title(axes, "Progress of the run")
    has_tumours = bool(np.isfinite(sensed).any())
    if has_tumours:
        _draw_series(axes, sensed, label="tumour sensed", colour=VERMILION)
        _draw_series(axes, ranked, label="AUPRC of the map", colour=BLUE)
    if target is not None:
        _draw_series(axes, target.sensed_fraction, label=f"{target.name} sensed", colour=PURPLE)
        _draw_series(axes, target.auprc, label=f"AUPRC of the map of {target.name}", colour=AMBER)
    if has_tumours or target is not None:
        _draw_goal(axes)
        axes.legend(loc="lower right", frameon=False, fontsize=10, labelcolor="linecolor", handlelength=1.4)
    else:
        _note(axes, "No tumour in this organ:\nthere is nothing to sense or to rank.")
    save(figure, path)


def new_figure(
    *, width_in: float, height_in: float, margins_in: Margins = (0.72, 0.22, 0.62, 0.52)
) -> tuple[Figure, Axes]:
    """A figure with one plain pair of axes, in the style of all figures.

    Args:
        width_in: Width [inch].
        height_in: Height [inch].
        margins_in: Room left, right, below and above the axes [inch]. It is given, since a layout that measures its
            labels draws everything twice.
    """
    figure = Figure(figsize=(width_in, height_in), dpi=DPI)
    FigureCanvasAgg(figure)
    left, right, below, above = margins_in
    axes = figure.add_axes(
        (
            left / width_in,
            below / height_in,
            (width_in - left - right) / width_in,
            (height_in - below - above) / height_in,
        )
    )
    make_plain(axes)
    return figure, axes


def set_title(
    axes: Axes, text: str, *, size_pt: float = TITLE_PT, pad_pt: float = 10.0, room_in: float | None = None
) -> None:
    """Set a title that ends before the right edge of the figure, in smaller letters or two lines where it is long.

    Args:
        axes: The axes, which begin where the title begins.
        text: The title; its own line breaks are kept.
        size_pt: Size of its letters where it fits [points].
        pad_pt: Room between it and the axes, where it has one line [points].
        room_in: Its greatest width [inch]; by default it ends at the figure's edge.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    to_edge_in = figure.get_figwidth() * (1.0 - axes.get_position().x0) - 0.1
    room_pt = 72.0 * (to_edge_in if room_in is None else room_in)
    most_lines = max(TITLE_LINES, text.count("\n") + 1)
    lines = text.split("\n")
    for size in np.arange(size_pt, LEAST_TITLE_PT - 0.1, -1.0):
        lines, size_pt = _in_lines(text, float(size), room_pt, figure.dpi), float(size)
        if len(lines) <= most_lines:
            break
    axes.set_title(
        "\n".join(lines),
        loc="left",
        fontsize=size_pt,
        color=INK,
        pad=pad_pt if len(lines) == 1 else min(pad_pt, 6.0),
        linespacing=LINE_SPACING,
    )


def _in_lines(text: str, size_pt: float, room_pt: float, dpi: float) -> list[str]:
    """A text in lines that are no wider than there is room; a single longer word stays whole."""
    lines: list[str] = []
    for paragraph in text.split("\n"):
        line = ""
        for word in paragraph.split(" "):
            longer = f"{line} {word}" if line else word
            if line and _width_pt(longer, size_pt, dpi) > room_pt:
                lines.append(line)
                longer = word
            line = longer
        lines.append(line)
    return lines


def _width_pt(text: str, size_pt: float, dpi: float) -> float:
    """The width of a line as it is drawn [points]; at a low resolution hinted letters are wider than their outlines."""
    if not text.strip():
        return 0.0
    font = FontProperties(size=size_pt)
    return 72.0 / dpi * _ruler(dpi).get_text_width_height_descent(text, font, ismath=False)[0]


@lru_cache(maxsize=4)
def _ruler(dpi: float) -> RendererAgg:
    return RendererAgg(1, 1, dpi)


def make_plain(axes: Axes) -> None:
    """Give axes the style of all figures."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(MUTED)
    axes.tick_params(colors=INK, length=3, width=0.8, labelsize=9)
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)


def save(figure: Figure, path: Path, *, source: str | None = None) -> None:
    """Write a figure as a PNG whose bytes depend only on the picture, and not on the version that drew it.

    Args:
        figure: The figure.
        path: The PNG.
        source: The file that the picture shows, which the PNG then names.
    """
    quick, marks = {"compress_level": 3}, {"Software": None} | ({} if source is None else {"Source": source})
    figure.savefig(path, dpi=DPI, facecolor="white", metadata=marks, pil_kwargs=quick)


def _by_rising_recall(
    recall: ArrayLike, precision: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The curve from recall 0 on, whose steps hold each precision back to the recall before."""
    recall, precision = np.asarray(recall, dtype=np.float64), np.asarray(precision, dtype=np.float64)
    return (recall[::-1], precision[::-1]) if recall[0] > recall[-1] else (recall, precision)


def _draw_ranking(
    axes: Axes, recall: NDArray[np.float64], precision: NDArray[np.float64], auprc: float
) -> None:
    """Draw the tumours' curve and the area under it."""
    axes.fill_between(recall, precision, step="pre", color=BLUE, alpha=0.12, linewidth=0)
    label = f"tumour: area {auprc:.2f}"
    axes.plot(recall, precision, drawstyle="steps-pre", color=BLUE, linewidth=2.2, label=label)


def _draw_prevalence(axes: Axes, prevalence: float) -> None:
    """Draw the precision of an uninformed map."""
    axes.axhline(prevalence, color=MUTED, linestyle=(0, (4, 3)), linewidth=1.2)
    style = {"textcoords": "offset points", "color": MUTED, "fontsize": 9}
    axes.annotate(f"uninformed map: {prevalence:.2g}", (0.0, prevalence), xytext=(6, 4), **style)


def _draw_target_ranking(axes: Axes, target: TargetCurves) -> None:
    """Draw the second class's curve, and a legend that tells it from the tumours'."""
    recall, precision = (np.asarray(values, dtype=np.float64) for values in (target.recall, target.precision))
    if recall.size:
        recall, precision = _by_rising_recall(recall, precision)
        area = float(np.asarray(target.auprc, dtype=np.float64)[-1])
        label = f"{target.name}: area {area:.2f}"
        axes.plot(recall, precision, drawstyle="steps-pre", color=AMBER, linewidth=2.2, label=label)
    if axes.lines:
        # Curves seldom pass here, and the line of the prevalence lies below.
        place = {"loc": "lower left", "bbox_to_anchor": (0.0, 0.06)}
        axes.legend(**place, frameon=False, fontsize=10, labelcolor="linecolor", handlelength=1.4)


def _draw_goal(axes: Axes) -> None:
    axes.axhline(SENSED_GOAL, color=MUTED, linestyle=(0, (4, 3)), linewidth=1.0)
    axes.annotate(
        f"{SENSED_GOAL:.0%} sensed",
        (0, SENSED_GOAL),
        xytext=(6, -4),
        textcoords="offset points",
        va="top",
        color=MUTED,
        fontsize=9,
    )


def _draw_series(axes: Axes, series: ArrayLike, *, label: str, colour: str) -> None:
    values = np.asarray(series, dtype=np.float64)
    actions = np.arange(1, len(values) + 1)
    axes.plot(actions, values, color=colour, linewidth=2.2, label=label, drawstyle="steps-post")
    axes.plot(actions[-1:], values[-1:], "o", color=colour, markersize=5, clip_on=False)


def _note(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=MUTED, fontsize=11)

"""The figure of a search for a base: a map of the table from above, coloured by what an arm reaches from there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PatchCollection
from matplotlib.colors import Normalize
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from sim.pictures.figures import INK, MUTED, VERMILION, new_figure, save, set_title

from .base_search import BaseQuestion, BaseSearch, Candidate
from .figures import COLOURS
from .workcell import Workcell

ARROW_MM = 70.0
"""Length of the arrow along which a base looks (the file's +x)."""
HINDERED = "#C9C9C9"
"""Colour of places in the table or in the organ."""


def draw_bases(
    path: Path,
    workcell: Workcell,
    found: BaseSearch,
    question: BaseQuestion,
    *,
    reached: tuple[float, float],
) -> None:
    """Write the map of a search for a base as a PNG: the grid's places as squares, those of the refinement as dots.

    Args:
        path: The file to write.
        workcell: The organ, and the arm where it stands.
        found: The search.
        question: How it searched.
        reached: Shares of the whole workspace that are reached from the best base and from the present one. The
            colours are of the poses that were drawn, with a candidate's effort.
    """
    figure, axes = new_figure(width_in=8.4, height_in=7.4, margins_in=(0.75, 1.1, 0.95, 0.8))
    measure, what = "reached_fraction", "Poses reached"
    if question.objective == "seen":
        measure, what = "seen_fraction", "Organ's inside seen"
    scale = Normalize(0.0, max(*(getattr(candidate, measure) for candidate in found.asked), 1e-9))
    grid = [candidate for candidate in found.candidates if candidate.stage == "grid"]
    has_hindered = _squares(axes, grid, measure, scale, found.spacing_m * 1e3)
    _dots(axes, [candidate for candidate in found.asked if candidate.stage == "refined"], measure, scale)
    _table(axes, workcell)
    _organ(axes, workcell)
    _mark(axes, found.candidates[0], "present base", "X")
    _mark(axes, found.best, "best base", "*")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.autoscale_view()
    if has_hindered:
        axes.add_patch(Rectangle((0, 0), 0, 0, color=HINDERED, label="no room for the base"))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=3, frameon=False, fontsize=9)
    # The same numbers, and as many digits of them, as the terminal prints.
    title = f"All poses: {reached[0]:.2%} reached from the best base, {reached[1]:.2%} from the present"
    if question.objective == "seen":
        best, present = (candidate.seen_fraction for candidate in (found.best, found.candidates[0]))
        title = f"{what}: {best:.1%} from the best base, {present:.1%} from the present"
    set_title(axes, f"{title} one\nbest: {found.best.stand.label}", size_pt=11.0)
    bar = figure.colorbar(ScalarMappable(scale, COLOURS), ax=axes, fraction=0.035, pad=0.03)
    bar.set_label(f"{what.lower()}, of {found.n_poses} poses drawn; best over heights", color=INK, fontsize=9)
    save(figure, path)


def _dots(axes: Axes, refined: list[Candidate], measure: str, scale: Normalize) -> None:
    """Draw the bases of the refinement."""
    xy_mm = _xy_mm(refined)
    axes.scatter(
        xy_mm[:, 0],
        xy_mm[:, 1],
        c=[getattr(candidate, measure) for candidate in refined],
        cmap=COLOURS,
        norm=scale,
        s=22,
        edgecolors="white",
        linewidths=0.6,
        zorder=4,
    )


def _organ(axes: Axes, workcell: Workcell) -> None:
    """Draw the organ's bounding box."""
    low_mm, high_mm = workcell.placed.organ.bounds_m * 1e3
    (x_mm, y_mm), (width_mm, height_mm) = low_mm[:2], (high_mm - low_mm)[:2]
    box = Rectangle(
        (x_mm, y_mm), width_mm, height_mm, fill=False, edgecolor=VERMILION, linewidth=1.6, zorder=5
    )
    axes.add_patch(box)
    label = {"xytext": (0, 4), "textcoords": "offset points", "color": VERMILION, "fontsize": 9}
    axes.annotate("organ", (x_mm, high_mm[1]), **label)


def _squares(axes: Axes, grid: list[Candidate], measure: str, scale: Normalize, side_mm: float) -> bool:
    """Draw the grid's places by the best value over heights, grey where none has room, and return if any is grey."""
    best: dict[tuple[float, float], float] = {}
    for candidate in grid:
        place = (round(candidate.stand.x_m * 1e3, 1), round(candidate.stand.y_m * 1e3, 1))
        best[place] = float(np.fmax(best.get(place, np.nan), getattr(candidate, measure)))
    patches = [Rectangle((x - side_mm / 2, y - side_mm / 2), side_mm, side_mm) for x, y in best]
    colours = [HINDERED if np.isnan(value) else COLOURS(scale(value)) for value in best.values()]
    axes.add_collection(PatchCollection(patches, facecolors=colours, edgecolors="white", linewidths=0.8))
    return any(np.isnan(value) for value in best.values())


def _table(axes: Axes, workcell: Workcell) -> None:
    """Draw the outline of the table's top."""
    table = workcell.scene.model.geom("table")
    (x_mm, y_mm), (half_x_mm, half_y_mm) = table.pos[:2] * 1e3, table.size[:2] * 1e3
    axes.add_patch(
        Rectangle(
            (x_mm - half_x_mm, y_mm - half_y_mm),
            2 * half_x_mm,
            2 * half_y_mm,
            fill=False,
            edgecolor=MUTED,
            linestyle=(0, (4, 3)),
            zorder=3,
        )
    )
    corner = (x_mm + half_x_mm, y_mm - half_y_mm)
    axes.annotate(
        "table", corner, xytext=(-4, 4), textcoords="offset points", ha="right", color=MUTED, fontsize=9
    )


def _mark(axes: Axes, candidate: Candidate, label: str, marker: str) -> None:
    """Draw a base with the direction it looks in."""
    x_mm, y_mm = _xy_mm([candidate])[0]
    yaw_rad = candidate.stand.yaw_rad
    tip = (x_mm + ARROW_MM * np.cos(yaw_rad), y_mm + ARROW_MM * np.sin(yaw_rad))
    axes.annotate("", tip, (x_mm, y_mm), arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.4}, zorder=6)
    axes.scatter(
        [x_mm],
        [y_mm],
        s=190 if marker == "*" else 80,
        marker=marker,
        color=VERMILION if marker == "*" else INK,
        edgecolors="white",
        linewidths=1.0,
        zorder=7,
        label=f"{label}, {candidate.stand.z_m * 1e3:.0f} mm high",
    )


def _xy_mm(candidates: list[Candidate]) -> NDArray[np.float64]:
    return np.array([[c.stand.x_m, c.stand.y_m] for c in candidates]).reshape(-1, 2) * 1e3

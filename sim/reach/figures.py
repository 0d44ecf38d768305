"""The figures of a reachability study: the organ coloured by score, and why poses are not reached."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray
from scipy.spatial import KDTree

from planner import Workspace
from sim.pictures.figures import BLUE, INK, MUTED, VERMILION, make_plain, new_figure, save, set_title
from sim.world.solids.solid import Solid

from .reachability import ReachStudy
from .workcell import Workcell

COLOURS = LinearSegmentedColormap.from_list("comfort", ["#F2E8C9", "#8CC6B0", "#2F8FA6", "#123F6B"])
"""From pale (at a limit, or nearly touching) to dark blue (comfortable): the lightness by itself tells the value."""
BARE = "#DCDCDC"
"""Colour of the surface that is no part of the workspace."""
BARE_LABEL = "no sensing pose there (edge, too steep, or not to be pressed)"
N_NEAR = 4
"""A face takes the mean score of this many nearest poses."""
REACH_SPACINGS = 2.5
"""A face farther than this many median spacings from every pose is no part of the workspace."""


def draw_reach(path: Path, organ: Solid, workspace: Workspace, study: ReachStudy) -> None:
    """Write the organ from above, coloured by score, with the poses that are not reached, as a PNG.

    Args:
        path: The file to write.
        organ: The organ in the world.
        workspace: The poses of the study.
        study: What the arm can do there.
    """
    width_in = 6.4
    height_in = _height_in(organ, width_in)
    figure, axes = new_figure(
        width_in=width_in + 1.8, height_in=height_in + 1.5, margins_in=(0.72, 1.08, 0.95, 0.55)
    )
    marks = _draw_organ(axes, organ, workspace, study)
    title = f"{study.is_reached.mean():.1%} of {len(study.is_reached)} poses reached"
    set_title(axes, title)
    handles: list[Artist] = [Patch(color=BARE)]
    labels = [BARE_LABEL]
    if not study.is_reached.all():
        handles, labels = [marks, *handles], ["not reached", *labels]
    axes.legend(
        handles, labels, loc="upper left", bbox_to_anchor=(-0.01, -0.1), ncols=2, frameon=False, fontsize=9
    )
    _score_bar(figure, axes)
    save(figure, path)


def draw_arms(path: Path, studies: Sequence[tuple[str, Workcell, ReachStudy]]) -> None:
    """Write the organ from above once for each arm, with its name and what it reaches, as a PNG."""
    n, panel_in = len(studies), 4.2
    height_in = _height_in(studies[0][1].placed.organ, panel_in)
    width_in = n * (panel_in + 0.55) + 1.3
    figure, first = new_figure(
        width_in=width_in,
        height_in=height_in + 1.35,
        margins_in=(0.72, width_in - 0.72 - panel_in, 0.72, 0.63),
    )
    place = first.get_position()
    for index, (name, workcell, study) in enumerate(studies):
        axes = first if index == 0 else figure.add_axes(place.bounds, sharey=first)
        make_plain(axes)
        axes.set_position(place.translated(index * (panel_in + 0.55) / width_in, 0.0))
        _draw_organ(axes, workcell.placed.organ, workcell.workspace, study)
        set_title(axes, f"{name}: {study.is_reached.mean():.1%} reached", room_in=panel_in + 0.4)
        axes.grid(visible=False)
        if index:
            axes.set_ylabel("")
    bar_axes = figure.add_axes((1.0 - 0.95 / width_in, place.y0, 0.16 / width_in, place.height))
    bar = figure.colorbar(ScalarMappable(Normalize(0, 1), COLOURS), cax=bar_axes)
    bar.set_label("score; dots: not reached; grey: no pose", color=INK, fontsize=9)
    save(figure, path)


def _height_in(organ: Solid, width_in: float) -> float:
    low_m, high_m = organ.bounds_m
    width_m, height_m = (high_m - low_m)[:2]
    return float(np.clip(width_in * height_m / width_m, 2.0, 8.0))


def _score_bar(figure: Figure, axes: Axes) -> None:
    bar = figure.colorbar(ScalarMappable(Normalize(0, 1), COLOURS), ax=axes, fraction=0.035, pad=0.03)
    bar.set_label("score: room to joint limits and obstacles", color=INK, fontsize=9)


def _draw_organ(axes: Axes, organ: Solid, workspace: Workspace, study: ReachStudy) -> PathCollection:
    """Draw the organ from above, coloured by score, and return the dots of the poses that are not reached."""
    low_m, high_m = organ.bounds_m
    triangles_mm, colours = _upper_faces(organ, workspace, study)
    axes.add_collection(
        PolyCollection(list(triangles_mm), facecolors=colours, edgecolors=colours, linewidths=0.3)
    )
    missed_mm = workspace.positions_m[~study.is_reached] * 1e3
    marks = axes.scatter(missed_mm[:, 0], missed_mm[:, 1], s=9, color=VERMILION, linewidths=0)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.set_xlim(low_m[0] * 1e3 - 5, high_m[0] * 1e3 + 5)
    axes.set_ylim(low_m[1] * 1e3 - 5, high_m[1] * 1e3 + 5)
    return marks


def _upper_faces(
    organ: Solid, workspace: Workspace, study: ReachStudy
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The faces that point up, lowest first, in x and y [mm], shape (F, 3, 2), and their colours, shape (F, 4)."""
    corners_m = organ.vertices_m[organ.faces]
    slope = organ.face_normals()[:, 2]
    rows = np.flatnonzero(slope > 0.0)
    rows = rows[np.argsort(corners_m[rows, :, 2].mean(axis=1), kind="stable")]
    score = np.nan_to_num(study.score, nan=0.0)
    tree = KDTree(workspace.positions_m)
    count = min(N_NEAR, workspace.n_poses)
    found = tree.query(corners_m[rows].mean(axis=1), k=max(count, 2))
    away_m, near = (np.asarray(part)[:, :count] for part in found)
    colours = COLOURS(score[near].mean(axis=1))
    spacing_m = np.median(np.asarray(tree.query(workspace.positions_m, k=2)[0])[:, 1])
    colours[away_m[:, 0] > REACH_SPACINGS * spacing_m] = to_rgba(BARE)
    colours[:, :3] *= (0.82 + 0.18 * slope[rows])[:, None]
    return corners_m[rows, :, :2] * 1e3, colours


def draw_reasons(path: Path, study: ReachStudy) -> None:
    """Write how many poses ended in each way as a PNG of bars, in another colour where they are not reached."""
    reasons = study.reasons()
    names = list(reasons)[::-1]
    figure, axes = new_figure(
        width_in=6.8, height_in=1.4 + 0.42 * max(len(names), 2), margins_in=(1.35, 0.7, 0.62, 0.52)
    )
    counts = [reasons[name] for name in names]
    labels = [name.replace("_", " ") for name in names]
    axes.barh(labels, counts, color=[BLUE if name == "reached" else VERMILION for name in names], height=0.62)
    for row, count in enumerate(counts):
        text = f"{count} ({count / len(study.results):.1%})"
        axes.annotate(text, (count, row), xytext=(5, 0), textcoords="offset points", va="center", color=MUTED)
    axes.set(xlabel="poses", xlim=(0, max(counts) * 1.22))
    axes.grid(visible=False, axis="y")
    set_title(axes, "How the poses of the workspace ended")
    save(figure, path)

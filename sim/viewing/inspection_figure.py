"""A patient's anatomy seen from the front, from the left and from above, in its own coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from sim.colours import KEEPOUT, STRUCTURE, TARGET, TRUTH
from sim.pictures.figures import INK, MUTED, save
from sim.world.anatomy.loading import LoadedAnatomy
from sim.world.solids.solid import Solid

VIEWS = (
    ("from the front", (0, 2), np.array([0.0, -1.0, 0.0]), ("left →", "head →")),
    ("from the left", (1, 2), np.array([1.0, 0.0, 0.0]), ("back →", "head →")),
    ("from the feet, as on CT", (0, 1), np.array([0.0, 0.0, -1.0]), ("left →", "front →")),
)
"""Title, axes drawn across and up (LPS), direction towards the viewer, and what the axes mean."""
PALE_ORGAN = "#DCCFCB"
"""The organ's colour on a white ground, where bodies in it have to show."""
INNER_ALPHA = 0.88
LIGHT = 0.55
"""Least brightness of a triangle seen edge on."""


def draw_inspection(path: Path, loaded: LoadedAnatomy, *, title: str, source: str | None = None) -> None:
    """Write three views of an anatomy as a PNG: what is in the organ shows through it.

    Args:
        path: The file to write.
        loaded: The anatomy, in patient axes.
        title: Title of the picture.
    """
    figure = Figure(figsize=(13.2, 5.0), layout="constrained")
    for index, axes in enumerate(figure.subplots(1, 3)):
        draw_view(axes, loaded, index)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, color=INK)
    handles = [Patch(color=PALE_ORGAN, label="organ")]
    handles += [Patch(color=TRUTH, label="tumours")] if loaded.tumours else []
    handles += [Patch(color=TARGET, label="targets")] if loaded.targets else []
    kinds = {each.is_keepout for each in loaded.structures}
    handles += [Patch(color=STRUCTURE, label="structures")] if False in kinds else []
    handles += [Patch(color=KEEPOUT, label="must not be pressed")] if True in kinds else []
    figure.legend(handles=handles, loc="outside lower left", ncols=5, frameon=False, fontsize=9)
    save(figure, path, source=source)


def draw_view(axes: Axes, loaded: LoadedAnatomy, index: int) -> None:
    """Draw one of the views.

    Args:
        axes: Where to draw.
        loaded: The anatomy, in patient axes.
        index: Which of `VIEWS`.
    """
    title, (across, up), towards, names = VIEWS[index]
    inner: Sequence[tuple[Solid, str]] = [
        *((each.solid, KEEPOUT if each.is_keepout else STRUCTURE) for each in loaded.structures),
        *((tumour, TRUTH) for tumour in loaded.tumours),
        *((target, TARGET) for target in loaded.targets),
    ]
    axes.add_collection(_shaded(loaded.organ, (across, up), towards, PALE_ORGAN))
    for solid, colour in inner:
        shaded = _shaded(solid, (across, up), towards, colour)
        shaded.set_alpha(INNER_ALPHA)
        axes.add_collection(shaded)
    low_mm, high_mm = loaded.organ.bounds_m[:, [across, up]] * 1e3
    margin_mm = 0.06 * (high_mm - low_mm).max()
    axes.set_xlim(low_mm[0] - margin_mm, high_mm[0] + margin_mm)
    y_mm = (low_mm[1] - margin_mm, high_mm[1] + margin_mm)
    # The front is up in the view from the feet, where LPS points to the back.
    axes.set_ylim(*(y_mm[::-1] if up == 1 else y_mm))
    axes.set_aspect("equal")
    axes.set_xlabel(f"{'LPS'[across]} [mm]   {names[0]}", fontsize=9, color=INK)
    axes.set_ylabel(f"{'LPS'[up]} [mm]   {names[1]}", fontsize=9, color=INK)
    axes.set_title(title, loc="left", fontsize=10, color=INK)
    axes.tick_params(labelsize=8, colors=MUTED)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _shaded(
    solid: Solid, plane: tuple[int, int], towards: NDArray[np.float64], colour: str
) -> PolyCollection:
    """The triangles that face the viewer, the nearest last; the more they face the viewer, the brighter they are."""
    facing = solid.face_normals() @ towards
    seen = np.flatnonzero(facing > 0.0)
    triangles_m = solid.vertices_m[solid.faces[seen]]
    order = np.argsort(triangles_m.mean(axis=1) @ towards)
    shade = LIGHT + (1.0 - LIGHT) * facing[seen][order, None]
    colours = np.array(to_rgb(colour)) * shade
    polygons = list(triangles_m[order][:, :, list(plane)] * 1e3)
    return PolyCollection(polygons, facecolors=colours, edgecolors=colours, linewidths=0.2)

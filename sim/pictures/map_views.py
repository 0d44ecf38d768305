"""The final map seen from above and from the side, as in the paper's figures.

Each view is a projection: the highest probability along the line of sight, the silhouettes of the organ and
of the true tumours, and the poses that were sensed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from sim.colours import MAP, PROBE, TARGET, TARGET_MAP, TRUTH

from .figures import INK, MUTED, new_figure, save, set_title
from .number_places import number_places
from .silhouettes import Raster, extended_to_all, lattice_silhouette, mesh_silhouette

View = Literal["top", "side"]

_AXES_OF_VIEW: dict[View, tuple[int, int, int]] = {"top": (0, 1, 2), "side": (0, 2, 1)}
"""For each view the world axes drawn across and up, and the line of sight."""
_MM_PER_M = 1e3
_MARGINS_IN = (0.72, 0.95, 0.95, 0.45)
_AXES_WIDTH_IN, _MOST_AXES_HEIGHT_IN = 5.9, 7.4
_NUMBER_PT = 10.5
"""Diameter of the disc that a number stands on [points]."""
_MOST_NUMBERED_POSES = 60
"""With more poses than this, their numbers would cover the map."""
_COLOURS = LinearSegmentedColormap.from_list(
    "likely", ["#EBF0F2", "#CBE1EF", "#7CB7DC", MAP, "#074C7E", "#05263F"]
)
"""From near white (surely free) over the map's blue to dark: the lightness by itself tells the value."""
_TARGET_COLOURS = LinearSegmentedColormap.from_list(
    "likely target", ["#F7F4EE", "#FBE6BC", "#F3C566", TARGET_MAP, "#9C6800", "#4A2F00"]
)
"""The same for a second class."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MapPicture:
    """What the views of a map show."""

    axes_m: Sequence[NDArray[np.float64]]
    """The lattice's coordinates along x, y and z [m, world], of lengths (X, Y, Z)."""
    probability: NDArray[np.float64]
    """Probability of tumour, shape (X, Y, Z); what lies outside the organ is not looked at and may be NaN."""
    is_tumour: NDArray[np.bool_]
    """The truth at the lattice points, shape (X, Y, Z)."""
    is_inside: NDArray[np.bool_]
    """Which lattice points lie in the organ, shape (X, Y, Z)."""
    poses_m: NDArray[np.float64]
    """Positions of the sensing actions [m, world], in order, shape (T, 3)."""
    organ_triangles_m: NDArray[np.float64] | None = None
    """Triangles of the organ's surface [m, world], shape (F, 3, 3); None to outline `is_inside` in their place."""
    tumour_triangles_m: NDArray[np.float64] | None = None
    """Triangles of all tumours [m, world], shape (F, 3, 3); None to outline `is_tumour` in their place."""
    target_name: str | None = None
    """What a second class is called, where `probability`, `is_tumour` and the outlines are of it; None for tumours."""

    @property
    def noun(self) -> str:
        """What is mapped, to follow "probability of"."""
        return self.target_name or "tumour"

    def __post_init__(self) -> None:
        """Check that all arrays describe one lattice."""
        shape = tuple(len(axis) for axis in self.axes_m)
        for name in ("probability", "is_tumour", "is_inside"):
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, but the axes span {shape}")
        if min(shape) < 2 or not self.is_inside.any():
            raise ValueError(
                f"a map's picture needs 2 points or more along each axis, some in the organ; got {shape}"
            )


def draw_map_view(path: Path, picture: MapPicture, *, view: View) -> None:
    """Write one view of the final map as a PNG.

    Args:
        path: The file to write.
        picture: The map, the truth, the organ and the poses.
        view: `top` looks down the z axis, `side` along the y axis.
    """
    across, up, sight = _AXES_OF_VIEW[view]
    raster = Raster.around(picture.axes_m[across], picture.axes_m[up])
    organ = _silhouette(raster, picture.is_inside, picture.organ_triangles_m, view=view, smoothing_cells=1.0)
    tumour = _silhouette(
        raster, picture.is_tumour, picture.tumour_triangles_m, view=view, smoothing_cells=0.5
    )
    likely = extended_to_all(highest_along(picture, sight), np.asarray(picture.is_inside.any(axis=sight)))
    left, right, bottom, top = raster.edges_m
    width_in, height_in = _AXES_WIDTH_IN, _AXES_WIDTH_IN * (top - bottom) / (right - left)
    if height_in > _MOST_AXES_HEIGHT_IN:
        width_in, height_in = width_in * _MOST_AXES_HEIGHT_IN / height_in, _MOST_AXES_HEIGHT_IN
    of_figure_in = (_AXES_WIDTH_IN + sum(_MARGINS_IN[:2]), height_in + sum(_MARGINS_IN[2:]))
    figure, axes = new_figure(width_in=of_figure_in[0], height_in=of_figure_in[1], margins_in=_MARGINS_IN)
    axes.set_anchor("W")
    image = axes.imshow(
        np.where(organ > 0.0, raster.interpolate(likely), np.nan).T,
        origin="lower",
        extent=(left * _MM_PER_M, right * _MM_PER_M, bottom * _MM_PER_M, top * _MM_PER_M),
        cmap=_COLOURS if picture.target_name is None else _TARGET_COLOURS,
        vmin=0.0,
        vmax=1.0,
        interpolation="bilinear",
    )
    _draw_outline(axes, raster, organ, colour=MUTED, line="solid")
    truth = TRUTH if picture.target_name is None else TARGET
    _draw_outline(axes, raster, tumour, colour=truth, line="dashed")
    _draw_poses(
        axes,
        picture.poses_m[:, [across, up]] * _MM_PER_M,
        mm_per_pt=(right - left) * _MM_PER_M / (72.0 * width_in),
    )
    axes.set(xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]", aspect="equal")
    axes.grid(visible=False)
    set_title(axes, _title(view, picture))
    beside = ((_MARGINS_IN[0] + width_in + 0.15) / of_figure_in[0], _MARGINS_IN[2] / of_figure_in[1])
    bar_axes = figure.add_axes((*beside, 0.16 / of_figure_in[0], height_in / of_figure_in[1]))
    _draw_colourbar(figure, image, bar_axes, f"highest probability of {picture.noun}")
    _draw_legend(figure, f"true {picture.target_name or 'tumours'}", truth)
    save(figure, path)


def highest_along(picture: MapPicture, axis: int) -> NDArray[np.float64]:
    """The highest probability inside the organ along an axis, a 2D array; 0 where the line misses it."""
    return np.where(picture.is_inside, picture.probability, 0.0).max(axis=axis)


def _silhouette(
    raster: Raster,
    mask: NDArray[np.bool_],
    triangles_m: NDArray[np.float64] | None,
    *,
    view: View,
    smoothing_cells: float,
) -> NDArray[np.float64]:
    """A silhouette, positive inside and negative outside: that of the triangles, or of the mask without triangles."""
    across, up, sight = _AXES_OF_VIEW[view]
    if triangles_m is not None:
        return mesh_silhouette(raster, triangles_m[:, :, [across, up]])
    return raster.interpolate(lattice_silhouette(np.asarray(mask.any(axis=sight)), smoothing_cells))


def _draw_outline(
    axes: Axes,
    raster: Raster,
    silhouette: NDArray[np.float64],
    *,
    colour: str,
    line: Literal["solid", "dashed"],
) -> None:
    if silhouette.max() <= 0.0:
        # An organ without tumours has nothing to outline.
        return
    across_m, up_m = raster.centres_m
    contour = axes.contour(
        across_m * _MM_PER_M, up_m * _MM_PER_M, silhouette.T, [0.0], colors=[colour], linestyles=[line]
    )
    contour.set(linewidth=1.5, path_effects=[withStroke(linewidth=3.0, foreground="white", alpha=0.8)])


def _draw_poses(axes: Axes, poses_mm: NDArray[np.float64], *, mm_per_pt: float) -> None:
    """Draw a dot at each pose, and beside or on it its number; numbers never lie on one another."""
    dot = {"markeredgecolor": "white", "markeredgewidth": 0.8, "clip_on": False, "linestyle": "none"}
    axes.plot(poses_mm[:, 0], poses_mm[:, 1], marker="o", color=PROBE, zorder=6, markersize=5.0, **dot)
    if len(poses_mm) > _MOST_NUMBERED_POSES:
        return
    places_mm = number_places(poses_mm, gap_mm=1.08 * _NUMBER_PT * mm_per_pt)
    for index, (pose_mm, place_mm) in enumerate(zip(poses_mm, places_mm, strict=True)):
        if not np.array_equal(pose_mm, place_mm):
            line = np.stack([pose_mm, place_mm])
            axes.plot(line[:, 0], line[:, 1], color=PROBE, linewidth=0.8, zorder=5, clip_on=False)
        axes.plot(*place_mm, marker="o", color=PROBE, zorder=7, markersize=_NUMBER_PT, **dot)
        text = {"fontsize": 6, "ha": "center", "va": "center_baseline", "zorder": 8}
        axes.text(place_mm[0], place_mm[1], str(index + 1), color="white", **text)


def _draw_colourbar(figure: Figure, image: AxesImage, axes: Axes, label: str) -> None:
    colourbar = figure.colorbar(image, cax=axes)
    colourbar.set_label(label, fontsize=9, color=INK)
    colourbar.ax.tick_params(labelsize=9, length=0)


def _draw_legend(figure: Figure, name: str, colour: str) -> None:
    handles = [
        Line2D([], [], color=MUTED, linewidth=1.5, label="organ"),
        Line2D([], [], color=colour, linewidth=1.5, linestyle="dashed", label=name),
        Line2D(
            [], [], color=PROBE, linestyle="none", marker="o", markersize=7, label="sensing poses, in order"
        ),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=3, frameon=False, fontsize=9)


def _title(view: View, picture: MapPicture) -> str:
    whose = "The map" if picture.target_name is None else f"The map of {picture.target_name}"
    seen, n_poses = {"top": "from above", "side": "from the side"}[view], len(picture.poses_m)
    return f"{whose} {seen}, after {n_poses} {'reading' if n_poses == 1 else 'readings'}"

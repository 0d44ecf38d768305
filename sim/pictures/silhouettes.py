"""Silhouettes of organ and tumours on a fine raster, for outlines without staircases.

A silhouette is an array that is positive inside and negative outside; its zero contour is the outline.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy import ndimage

_PIXELS_ACROSS = 800
"""Width of the raster: about the pixels that the picture gives it."""
_MARGIN_CELLS = 1.0
"""Room around the outermost lattice points, in lattice cells, so that an organ's true edge is never cut."""


@dataclass(frozen=True, eq=False)
class Raster:
    """A fine pixel raster over a 2D lattice, with square pixels."""

    lattice_m: tuple[NDArray[np.float64], NDArray[np.float64]]
    """The lattice's evenly spaced coordinates across and up [m]."""
    centres_m: tuple[NDArray[np.float64], NDArray[np.float64]]
    """The pixels' centres across and up [m]."""

    @classmethod
    def around(cls, across_m: NDArray[np.float64], up_m: NDArray[np.float64]) -> "Raster":
        """The raster over a lattice and a margin of one cell.

        Args:
            across_m: Evenly spaced coordinates across [m], two or more.
            up_m: Evenly spaced coordinates up [m], two or more.
        """
        spans = [_widened(axis) for axis in (across_m, up_m)]
        pixel_m = (spans[0][1] - spans[0][0]) / _PIXELS_ACROSS
        counts = [max(int(np.ceil((high - low) / pixel_m)), 2) for low, high in spans]
        centres = [
            low + (np.arange(count) + 0.5) * (high - low) / count
            for (low, high), count in zip(spans, counts, strict=True)
        ]
        return cls((across_m, up_m), (centres[0], centres[1]))

    @property
    def edges_m(self) -> tuple[float, float, float, float]:
        """The left, right, bottom and top edge [m]."""
        (left, right), (bottom, top) = (_widened(axis) for axis in self.lattice_m)
        return left, right, bottom, top

    @property
    def size_m(self) -> tuple[float, float]:
        """The width and the height [m]."""
        left, right, bottom, top = self.edges_m
        return right - left, top - bottom

    def interpolate(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Lattice values at the pixels' centres, by linear interpolation; constant beyond the outermost points.

        Args:
            values: One value per lattice point, shape (across, up).
        """
        indices = [
            (centres - axis[0]) / (axis[1] - axis[0])
            for axis, centres in zip(self.lattice_m, self.centres_m, strict=True)
        ]
        return ndimage.map_coordinates(values, np.meshgrid(*indices, indexing="ij"), order=1, mode="nearest")


def extended_to_all(values: NDArray[np.float64], is_known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The values, with that of the nearest known lattice point in the place of each unknown one.

    Args:
        values: A 2D array.
        is_known: Which of its values count, at least one.
    """
    nearest = ndimage.distance_transform_edt(~is_known, return_distances=False, return_indices=True)
    return values[tuple(np.asarray(nearest))]


def lattice_silhouette(mask: NDArray[np.bool_], smoothing_cells: float) -> NDArray[np.float64]:
    """The smoothed signed distance to a mask's edge in lattice cells, of the mask's shape.

    Args:
        mask: A 2D mask.
        smoothing_cells: Width of the Gaussian blur in cells. Up to 0.5, a tumour of one single cell is kept.
    """
    if not mask.any():
        return np.full(mask.shape, -1.0)
    # The lattice's edge closes what touches it.
    padded = np.pad(mask, 1)
    inward = np.asarray(ndimage.distance_transform_edt(padded))
    outward = np.asarray(ndimage.distance_transform_edt(~padded))
    signed = np.where(padded, inward - 0.5, 0.5 - outward)
    return ndimage.gaussian_filter(signed, smoothing_cells, mode="nearest")[1:-1, 1:-1]


def mesh_silhouette(raster: Raster, triangles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The shadow of a mesh on the raster: 1/2 inside, -1/2 outside, softened over about a pixel.

    Args:
        raster: The raster.
        triangles_m: The triangles' corners, across and up [m], shape (F, 3, 2).
    """
    n_across, n_up = (len(centres) for centres in raster.centres_m)
    left, _, bottom, _ = raster.edges_m
    pixel_m = np.array(raster.size_m) / (n_across, n_up)
    corners = (triangles_m - (left, bottom)) / pixel_m - 0.5
    image = Image.new("L", (n_across, n_up), 0)
    draw = ImageDraw.Draw(image)
    for triangle in corners.reshape(-1, 6):
        draw.polygon(triangle.tolist(), fill=1)
    return ndimage.gaussian_filter(np.asarray(image, dtype=np.float64).T, 0.8) - 0.5


def _widened(axis_m: NDArray[np.float64]) -> tuple[float, float]:
    margin_m = _MARGIN_CELLS * (axis_m[1] - axis_m[0])
    return float(axis_m[0] - margin_m), float(axis_m[-1] + margin_m)

"""Scan conversion: which samples each pixel of a picture lies between."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.errors import FieldError
from sim.world.memory import spare_bytes

from .convex_array import ConvexArray

BYTES_PER_PIXEL = 120
"""Memory that a pixel takes while the table is made."""


@dataclass(frozen=True, eq=False)
class Fan:
    """The table by which the lines of an array become a square picture with the face on top and square pixels."""

    n_pixels: int
    """Pixels along each edge."""
    pixel_m: float
    """Edge of a pixel [m]."""
    left_m: float
    """The x of the first column's left edge in the plane [m]."""
    top_m: float
    """The z of the first row's upper edge in the plane [m]."""
    pixels: NDArray[np.int64]
    """Numbers of the pixels in the fan, row by row, shape (N,)."""
    corners: NDArray[np.int64]
    """Number of the sample above and to the left of each, and the number of lines at the end, shape (N + 1,)."""
    parts: NDArray[np.float32]
    """How far each lies towards the next sample and the next line, shape (N, 2)."""


def make_fan(array: ConvexArray, n_pixels: int = 512) -> Fan:
    """The table of an array.

    Args:
        array: What draws the lines.
        n_pixels: Pixels along each edge of the picture, at least 16.

    Raises:
        FieldError: Too few pixels, or more than fit memory.
    """
    if n_pixels < 16:
        raise FieldError("image_pixels", n_pixels, "must be at least 16.")
    needed = BYTES_PER_PIXEL * float(n_pixels) ** 2
    if needed > spare_bytes():
        text = f"a picture takes {needed / 2**30:.0f} GiB while it is drawn, more than there is; name fewer pixels."
        raise FieldError("image_pixels", n_pixels, text)
    far_m = array.radius_m + array.depth_m
    top_m = array.radius_m * (math.cos(array.half_angle_rad) - 1.0)
    pixel_m = max(2.0 * far_m * math.sin(array.half_angle_rad), array.depth_m - top_m) / n_pixels
    left_m = -0.5 * n_pixels * pixel_m
    x_m = left_m + (np.arange(n_pixels) + 0.5) * pixel_m
    z_m = top_m + (np.arange(n_pixels) + 0.5)[:, None] * pixel_m + array.radius_m
    sample = (np.hypot(x_m, z_m) - array.radius_m) / array.sample_m - 0.5
    line = (np.arctan2(x_m, z_m) + array.half_angle_rad) / array.line_rad
    is_in = (line >= 0.0) & (line <= array.n_lines - 1) & (sample >= -0.5) & (sample <= array.n_samples - 0.5)
    pixels = np.flatnonzero(is_in)
    sample, line = np.maximum(sample.ravel()[pixels], 0.0), line.ravel()[pixels]
    above = np.minimum(sample.astype(np.int64), array.n_samples - 2)
    left = np.minimum(line.astype(np.int64), array.n_lines - 2)
    parts = np.clip(np.column_stack([sample - above, line - left]), 0.0, 1.0).astype(np.float32)
    corners = np.append(above * array.n_lines + left, array.n_lines)
    return Fan(n_pixels, pixel_m, left_m, top_m, pixels, corners, parts)

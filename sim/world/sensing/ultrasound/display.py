"""From echoes to a picture: the compiled loops that spread them by beam and pulse, compress them and draw the fan."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.errors import FieldError
from sim.world.memory import spare_bytes

from .compiling import compiled
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


@compiled
def spread_across(
    signal: NDArray[np.float32],
    kernels: NDArray[np.float32],
    counts: NDArray[np.int64],
    noise: NDArray[np.float32],
    offset: int,
) -> None:
    """Spreads each sample's echoes over the lines by the beam's profile at its depth, and adds the receiver's noise.

    Args:
        signal: Echoes in phase and in quadrature by turns, shape (S, 2 L), changed in place.
        kernels: Right halves of the profiles, the middle first, shape (S, K).
        counts: How many values of each count, shape (S,).
        noise: A table of noise, shape (N,), of which a row of echoes takes a run that begins anywhere.
        offset: Where in the table to begin.
    """
    n_samples, n_values = signal.shape
    row = np.empty(n_values, dtype=np.float32)
    for s in range(n_samples):
        into = signal[s]
        start = (offset + s * n_values) % (noise.shape[0] - n_values)
        for at in range(n_values):
            row[at] = into[at]
            into[at] = kernels[s, 0] * row[at] + noise[start + at]
        for k in range(1, counts[s]):
            weight = kernels[s, k]
            for at in range(n_values - 2 * k):
                into[at] += weight * row[at + 2 * k]
            for at in range(2 * k, n_values):
                into[at] += weight * row[at - 2 * k]


@compiled
def spread_along(
    signal: NDArray[np.float32],
    kernel: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Spreads echoes along the lines by the pulse.

    Args:
        signal: Echoes, shape (S, V).
        kernel: The pulse's envelope, shape (odd,).
        out: Output, shape (S, V).
    """
    n_samples, n_values = signal.shape
    half = kernel.shape[0] // 2
    for s in range(n_samples):
        into = out[s]
        into[:] = np.float32(0.0)
        for k in range(max(-half, -s), min(half, n_samples - 1 - s) + 1):
            weight, row = kernel[half + k], signal[s + k]
            for at in range(n_values):
                into[at] += weight * row[at]


@compiled
def compress(
    signal: NDArray[np.float32],
    gains: NDArray[np.float32],
    white: float,
    range_db: float,
    out: NDArray[np.float32],
) -> None:
    """The brightness of each sample: the logarithm of its envelope within the range, from 0 to 255.

    Args:
        signal: Echoes in phase and in quadrature, shape (S, L, 2).
        gains: Time-gain compensation, as a factor of the amplitude at each sample, shape (S,).
        white: Amplitude that is white.
        range_db: How far below it black begins [dB].
        out: Output, shape (S, L).
    """
    n_samples, n_lines = out.shape
    scale = 10.0 / range_db
    for s in range(n_samples):
        factor = (gains[s] / white) ** 2
        for line in range(n_lines):
            real, imaginary = signal[s, line, 0], signal[s, line, 1]
            value = 1.0 + scale * math.log10(factor * (real * real + imaginary * imaginary) + 1e-20)
            out[s, line] = 255.0 * min(max(value, 0.0), 1.0)


@compiled
def draw_fan(
    lines: NDArray[np.float32],
    pixels: NDArray[np.int64],
    corners: NDArray[np.int64],
    parts: NDArray[np.float32],
    image: NDArray[np.uint8],
) -> None:
    """Fills the pixels of the fan with what lies between samples and lines.

    Args:
        lines: Brightness, shape (S L,), samples first.
        pixels: Numbers of the pixels in the fan, shape (N,).
        corners: For each the number of the sample above and to the left of it, and L, shape (N,) and 1 more at the end.
        parts: How far each lies towards the next sample and the next line, shape (N, 2).
        image: Output, shape (pixels of the image,).
    """
    n_lines = corners[-1]
    for n in range(pixels.shape[0]):
        at, down, right = corners[n], parts[n, 0], parts[n, 1]
        above = lines[at] + right * (lines[at + 1] - lines[at])
        below = lines[at + n_lines] + right * (lines[at + n_lines + 1] - lines[at + n_lines])
        image[pixels[n]] = np.uint8(above + down * (below - above) + 0.5)

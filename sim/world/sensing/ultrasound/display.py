"""The compiled loops that spread the echoes by the beam and the pulse, compress them, and draw the fan."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .compiling import compiled


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

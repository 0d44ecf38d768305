"""The layers of the network as compiled loops: convolutions of 3 x 3 and 1 x 1, the pooling and the widening.

Maps of features have shape (channels, rows + 2, columns + 2): a border of zeros stands about each, so that no loop asks
where the picture ends. All are in single precision, and each sum runs in a fixed order: the same picture gives the same
bytes, whatever the number of threads.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..ultrasound.compiling import compiled

BLOCK = 4
"""Channels that a convolution makes at once from what it reads; their number is a multiple of it."""


@compiled
def convolve(
    maps: NDArray[np.float32],
    kernels: NDArray[np.float32],
    biases: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Convolves by 3 x 3 and cuts off what is below 0.

    Args:
        maps: Input, shape (C, R + 2, W + 2).
        kernels: Weights, shape (O, C, 3, 3); O is a multiple of `BLOCK`.
        biases: What is added, shape (O,).
        out: Output, shape (O, R + 2, W + 2), whose border stays as it is.
    """
    n_out, n_in = kernels.shape[:2]
    n_rows, n_columns = maps.shape[1] - 2, maps.shape[2] - 2
    zero = np.float32(0.0)
    sums = np.empty((BLOCK, n_columns), dtype=np.float32)
    for first in range(0, n_out, BLOCK):
        for row in range(n_rows):
            for k in range(BLOCK):
                sums[k, :] = biases[first + k]
            for c in range(n_in):
                for dy in range(3):
                    line = maps[c, row + dy]
                    a0, a1, a2 = kernels[first, c, dy, 0], kernels[first, c, dy, 1], kernels[first, c, dy, 2]
                    b0, b1, b2 = (
                        kernels[first + 1, c, dy, 0],
                        kernels[first + 1, c, dy, 1],
                        kernels[first + 1, c, dy, 2],
                    )
                    c0, c1, c2 = (
                        kernels[first + 2, c, dy, 0],
                        kernels[first + 2, c, dy, 1],
                        kernels[first + 2, c, dy, 2],
                    )
                    d0, d1, d2 = (
                        kernels[first + 3, c, dy, 0],
                        kernels[first + 3, c, dy, 1],
                        kernels[first + 3, c, dy, 2],
                    )
                    for x in range(n_columns):
                        left, middle, right = line[x], line[x + 1], line[x + 2]
                        sums[0, x] += a0 * left + a1 * middle + a2 * right
                        sums[1, x] += b0 * left + b1 * middle + b2 * right
                        sums[2, x] += c0 * left + c1 * middle + c2 * right
                        sums[3, x] += d0 * left + d1 * middle + d2 * right
            for k in range(BLOCK):
                into = out[first + k, row + 1]
                for x in range(n_columns):
                    into[x + 1] = max(sums[k, x], zero)


@compiled
def pool(maps: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """The largest of each 2 x 2 cells.

    Args:
        maps: Input, shape (C, 2 R + 2, 2 W + 2).
        out: Output, shape (C, R + 2, W + 2), whose border stays as it is.
    """
    n_channels, n_rows, n_columns = out.shape
    for c in range(n_channels):
        for row in range(n_rows - 2):
            above, below, into = maps[c, 2 * row + 1], maps[c, 2 * row + 2], out[c, row + 1]
            for x in range(n_columns - 2):
                left = max(above[2 * x + 1], below[2 * x + 1])
                right = max(above[2 * x + 2], below[2 * x + 2])
                into[x + 1] = max(left, right)


@compiled
def widen_onto(
    maps: NDArray[np.float32],
    weights: NDArray[np.float32],
    biases: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Mixes the channels of each cell, and adds what comes out to the 2 x 2 cells that it stands for.

    Args:
        maps: Input, shape (C, R + 2, W + 2).
        weights: Weights of the mixing, shape (O, C).
        biases: What is added, shape (O,).
        out: Added to, shape (O, 2 R + 2, 2 W + 2).
    """
    n_out, n_in = weights.shape
    n_rows, n_columns = maps.shape[1] - 2, maps.shape[2] - 2
    sums = np.empty(n_columns, dtype=np.float32)
    for o in range(n_out):
        for row in range(n_rows):
            sums[:] = biases[o]
            for c in range(n_in):
                line, weight = maps[c, row + 1], weights[o, c]
                for x in range(n_columns):
                    sums[x] += weight * line[x + 1]
            for dy in range(2):
                into = out[o, 2 * row + 1 + dy]
                for x in range(n_columns):
                    into[2 * x + 1] += sums[x]
                    into[2 * x + 2] += sums[x]


@compiled
def mix(
    maps: NDArray[np.float32],
    weights: NDArray[np.float32],
    bias: float,
    out: NDArray[np.float32],
) -> None:
    """Mixes the channels of each cell into one number.

    Args:
        maps: Input, shape (C, R + 2, W + 2).
        weights: Weights, shape (C,).
        bias: What is added.
        out: Output, shape (R, W).
    """
    n_rows, n_columns = out.shape
    for row in range(n_rows):
        into = out[row]
        into[:] = np.float32(bias)
        for c in range(len(weights)):
            line, weight = maps[c, row + 1], weights[c]
            for x in range(n_columns):
                into[x] += weight * line[x + 1]

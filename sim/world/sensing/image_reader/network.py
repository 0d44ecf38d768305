"""The network: a U-Net (Ronneberger et al. 2015) small enough for one core, which adds its skipped maps on the way up.

    down:  two convolutions of 3 x 3 at each level, between levels the largest of 2 x 2 cells
    up:    the level below is mixed to this one's channels, widened to twice its size and added to this level's maps;
           then one convolution of 3 x 3
    head:  the channels of the finest level, mixed into the log odds that a cell is lesion, before their calibration

Every convolution of 3 x 3 ends with max(x, 0).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .layers import convolve, mix, pool, widen_onto
from .weights import ReaderWeights

Maps = NDArray[np.float32]


def logits_of(weights: ReaderWeights, frames: Maps) -> Maps:
    """The network's answer for the middle plane of each frame, shape (P, rows, columns).

    Args:
        weights: The trained network.
        frames: What it reads, shape (P, channels, rows, columns); rows and columns can be halved at each level.
    """
    n_planes, n_channels, n_rows, n_columns = frames.shape
    out = np.empty((n_planes, n_rows, n_columns), np.float32)
    bordered = _blank(n_channels, n_rows, n_columns)
    for frame, answer in zip(frames, out, strict=True):
        bordered[:, 1:-1, 1:-1] = frame
        finest = _up(weights, _down(weights, bordered))
        mix(finest, weights.arrays["head.weight"], float(weights.arrays["head.bias"][0]), answer)
    return out


def _down(weights: ReaderWeights, maps: Maps) -> list[Maps]:
    """The maps of each level, the finest first."""
    levels: list[Maps] = []
    for level, width in enumerate(weights.widths):
        if level:
            halved = _blank(len(maps), (maps.shape[1] - 2) // 2, (maps.shape[2] - 2) // 2)
            pool(maps, halved)
            maps = halved
        for n in range(2):
            maps = _convolved(weights, f"down{level}.{n}", maps, width)
        levels.append(maps)
    return levels


def _up(weights: ReaderWeights, levels: list[Maps]) -> Maps:
    """The maps of the finest level with what all others add; the levels' maps are changed."""
    below = levels[-1]
    for level in range(len(levels) - 2, -1, -1):
        name, maps = f"mix{level}", levels[level]
        widen_onto(below, weights.arrays[f"{name}.weight"], weights.arrays[f"{name}.bias"], maps)
        below = _convolved(weights, f"up{level}", maps, weights.widths[level])
    return below


def _convolved(weights: ReaderWeights, name: str, maps: Maps, width: int) -> Maps:
    out = _blank(width, maps.shape[1] - 2, maps.shape[2] - 2)
    convolve(maps, weights.arrays[f"{name}.weight"], weights.arrays[f"{name}.bias"], out)
    return out


def _blank(n_channels: int, n_rows: int, n_columns: int) -> Maps:
    """Maps of zeros with their border."""
    return np.zeros((n_channels, n_rows + 2, n_columns + 2), np.float32)

"""Smooth edges in pictures that were drawn with one sample per pixel.

Several samples per pixel look a little better, but a software renderer takes twice as long for them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

EDGE_STEP = 24
"""Smaller steps of the green channel between neighbours, of 255, are shading and no edge."""
_KERNEL = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]])


def smooth_edges(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A copy of a picture, shape (height, width, 3), in which pixels at edges are the mean of their surroundings.

    The mean is binomial over 3 x 3 pixels; all other pixels and the outermost ones stay as they are.
    """
    height_px, width_px = pixels.shape[:2]
    edge = np.flatnonzero(_is_at_edge(pixels[:, :, 1]))
    flat = pixels.reshape(-1, 3)
    sums = np.zeros((len(edge), 3), dtype=np.uint16)
    for (row, column), share in np.ndenumerate(_KERNEL):
        sums += flat[edge + (row - 1) * width_px + column - 1] * np.uint16(share)
    smooth = flat.copy()
    smooth[edge] = (sums + 8) >> 4
    return smooth.reshape(height_px, width_px, 3)


def _is_at_edge(lightness: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Which pixels differ from a neighbour, without those at the picture's border."""
    values = lightness.astype(np.int16)
    is_edge = np.zeros(values.shape, dtype=np.bool_)
    across, down = (np.abs(np.diff(values, axis=axis)) > EDGE_STEP for axis in (1, 0))
    is_edge[:, 1:] |= across
    is_edge[:, :-1] |= across
    is_edge[1:] |= down
    is_edge[:-1] |= down
    is_edge[[0, -1]] = is_edge[:, [0, -1]] = False
    return is_edge

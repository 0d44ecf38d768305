"""Places for the numbers of points in a plane: on the point where there is room, or near it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

N_TURNS, N_RINGS = 24, 40
"""Directions and distances that are tried around a point; the nearest free place is taken."""
RING_GAP = 0.5
"""Distance between two rings, in discs."""


def number_places(points: NDArray[np.float64], *, gap_mm: float) -> NDArray[np.float64]:
    """Where the numbers of points stand, shape (N, 2), no two nearer than a gap.

    Args:
        points: The points [mm], shape (N, 2).
        gap_mm: Least distance between the middles of two numbers [mm].
    """
    turns = np.linspace(0.0, 2.0 * np.pi, N_TURNS, endpoint=False) + np.pi / 2.0
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    radii = RING_GAP * gap_mm * np.arange(2, N_RINGS + 2)
    offsets = np.concatenate([np.zeros((1, 2)), (radii[:, None, None] * ring).reshape(-1, 2)])
    places = np.empty((0, 2))
    for point in points:
        tried = point + offsets
        apart = np.linalg.norm(tried[:, None] - places, axis=2).min(axis=1, initial=np.inf)
        is_free = apart >= gap_mm * (1.0 - 1e-9)
        # With more points than the rings have room for, the emptiest place is the best there is.
        best = int(np.argmax(is_free)) if is_free.any() else int(np.argmax(apart))
        places = np.vstack([places, tried[best]])
    return places

"""How far points of an organ go when what is believed of its place changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..labelled_points import LabelledPoints


def most_moved_m(
    readings: Sequence[LabelledPoints],
    now: Sequence[NDArray[np.float64]],
    before: Sequence[NDArray[np.float64]],
) -> float:
    """How far the points of some reading lie from where they were, the largest root mean square [m].

    Args:
        readings: The readings, at rest.
        now: What takes each to rest now, shapes (4, 4).
        before: What took it there.
    """
    told = zip(readings, now, before, strict=True)
    squares = (moved_m(each.points_m, T - other) ** 2 for each, T, other in told if len(each.points_m))
    return float(np.sqrt(max((each.mean() for each in squares), default=0.0)))


def moved_m(points_m: NDArray[np.float64], difference: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far points [m], shape (N, 3), lie apart under two moves, of which this is the difference [m], shape (N,)."""
    return np.linalg.norm(points_m @ difference[:3, :3].T + difference[:3, 3], axis=1)

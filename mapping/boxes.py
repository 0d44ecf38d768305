"""Boxes around clusters of points, snapped to a grid so that they seldom move."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label


class Box(NamedTuple):
    """A box aligned with the axes, as whole steps of a grid through the origin."""

    low: tuple[int, int, int]
    """Lowest corner [steps]."""
    high: tuple[int, int, int]
    """Highest corner [steps]."""
    step_m: float
    """Length of a step [m]."""

    @property
    def low_m(self) -> NDArray[np.float64]:
        """Lowest corner [m], shape (3,)."""
        return np.array(self.low) * self.step_m

    @property
    def high_m(self) -> NDArray[np.float64]:
        """Highest corner [m], shape (3,)."""
        return np.array(self.high) * self.step_m

    def holds(self, points_m: NDArray[np.float64], margin_m: float = 0.0) -> NDArray[np.bool_]:
        """Which points lie in the box or within a margin of its faces, shape (N,)."""
        is_inside = (points_m >= self.low_m - margin_m) & (points_m <= self.high_m + margin_m)
        return np.all(is_inside, axis=1)


def boxes_around(points_m: NDArray[np.float64], *, margin_m: float, step_m: float) -> list[Box]:
    """The boxes that hold each cluster of points with a margin around it; boxes of different clusters may overlap.

    Points belong to one cluster when the cubes of side `step_m` that hold them touch.

    Args:
        points_m: Points [m], shape (P, 3).
        margin_m: Least distance of a point from its box's faces [m].
        step_m: Side of the cubes, and the grid on which the boxes lie [m].
    """
    if not len(points_m):
        return []
    cubes = np.floor(points_m / step_m).astype(int)
    first = cubes.min(axis=0)
    is_taken = np.zeros(cubes.max(axis=0) - first + 1, dtype=bool)
    is_taken[tuple((cubes - first).T)] = True
    # The stubs know one of the two forms of its result.
    numbered: Any = label(is_taken, structure=np.ones((3, 3, 3)))
    cluster_of = numbered[0][tuple((cubes - first).T)]
    boxes = []
    for number in range(1, int(numbered[1]) + 1):
        inside_m = points_m[cluster_of == number]
        low = np.floor((inside_m.min(axis=0) - margin_m) / step_m).astype(int)
        high = np.ceil((inside_m.max(axis=0) + margin_m) / step_m).astype(int)
        boxes.append(Box(tuple(low.tolist()), tuple(high.tolist()), step_m))
    return boxes

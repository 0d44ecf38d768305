"""The search points' lattice, refined: where a tumour holds ten search points, it holds hundreds of fine ones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates
from scipy.spatial import KDTree

from ..keyed_array import KeyedArray
from ..situation import Situation

MAX_SPACING_M = 0.0045
"""Largest spacing of a fine lattice [m]: less than half the radius of the smallest tumour of interest."""


@dataclass(frozen=True, eq=False)
class FineLattice:
    """Points among and between the search points, and the interpolation from these to those."""

    points_m: NDArray[np.float64]
    """Fine points inside the organ [m, world], shape (F, 3)."""
    cell_m3: float
    """Volume for which each of them stands [m^3]."""
    _coordinates: NDArray[np.float64]
    """Their coordinates in steps of the search points' lattice, shape (3, F)."""
    _shape: tuple[int, int, int]
    """Shape of that lattice."""
    _source: NDArray[np.intp]
    """The search point nearest to each of its places, shape (number of places,)."""

    def interpolate(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at the fine points, shape (F,), by trilinear interpolation; beyond the organ the nearest value holds.

        Args:
            values: Values at the search points, shape (M,).
        """
        return map_coordinates(values[self._source].reshape(self._shape), self._coordinates, order=1)

    def near(self, places_m: NDArray[np.float64], margin_m: float) -> NDArray[np.intp]:
        """The indices of the fine points within a margin of some place, ascending.

        Args:
            places_m: Places [m], shape (P, 3).
            margin_m: The margin [m].
        """
        if not len(places_m):
            return np.empty(0, dtype=np.intp)
        low_m, high_m = places_m.min(axis=0) - margin_m, places_m.max(axis=0) + margin_m
        is_close = ((self.points_m >= low_m) & (self.points_m <= high_m)).all(axis=1)
        close = np.flatnonzero(is_close)
        gap_m, _ = KDTree(places_m).query(self.points_m[close], distance_upper_bound=margin_m)
        return close[np.isfinite(gap_m)]


def fine_lattice(points_m: NDArray[np.float64]) -> FineLattice:
    """The refined lattice of search points; it is kept, and returned again for the same array.

    Args:
        points_m: Points of a lattice aligned with the axes, some left out [m], shape (M, 3).
    """
    return _fine_lattice(KeyedArray(points_m))


def likely_m3(situation: Situation) -> float:
    """The volume in which the map takes tumour to be likelier than not [m^3]."""
    lattice = fine_lattice(situation.search_points_m)
    share = float(np.mean(situation.belief("find-and-outline").score > 0.0))
    return share * lattice.cell_m3 * len(lattice.points_m)


@lru_cache(maxsize=4)
def _fine_lattice(points: KeyedArray) -> FineLattice:
    axes_m, index = [], []
    for coordinate in points.array.T:
        values, where = np.unique(np.round(coordinate, 9), return_inverse=True)
        axes_m.append(values)
        index.append(where)
    shape = (axes_m[0].size, axes_m[1].size, axes_m[2].size)
    is_point = np.zeros(shape, dtype=bool)
    is_point[tuple(index)] = True
    number = np.zeros(shape, dtype=np.intp)
    number[tuple(index)] = np.arange(len(points.array))
    nearest = np.asarray(distance_transform_edt(~is_point, return_distances=False, return_indices=True))
    source = number[tuple(nearest)].ravel()
    steps = [np.median(np.diff(axis)) if axis.size > 1 else MAX_SPACING_M for axis in axes_m]
    factors = [max(1, math.ceil(step / MAX_SPACING_M)) for step in steps]
    fine = [
        np.arange((axis.size - 1) * factor + 1) / factor for axis, factor in zip(axes_m, factors, strict=True)
    ]
    coordinates = np.stack([part.ravel() for part in np.meshgrid(*fine, indexing="ij")])
    is_inside = map_coordinates(is_point.astype(np.float64), coordinates, order=1) >= 0.5
    coordinates = np.ascontiguousarray(coordinates[:, is_inside])
    fine_m = [np.interp(at, np.arange(axis.size), axis) for at, axis in zip(coordinates, axes_m, strict=True)]
    cell_m3 = float(np.prod([step / factor for step, factor in zip(steps, factors, strict=True)]))
    return FineLattice(np.column_stack(fine_m), cell_m3, coordinates, shape, source)

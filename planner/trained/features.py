"""What the trained planner looks at: distances of places to what was sensed, as hats over knots.

A distance becomes the values of hat functions (linear splines), so that the product of features and numbers is a
piecewise linear function of the distance, whose values at the knots are the numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..find_and_outline.fine_lattice import fine_lattice
from ..find_and_outline.hidden_balls import distance_to_cones
from ..keyed_array import KeyedArray
from ..situation import Situation

CONE_KNOTS_M = (0.0, 0.003, 0.006, 0.012, 0.024)
"""Distances to the nearest sensed cone [m]; at the last one the worth is 1."""
DEPTH_KNOTS_M = (0.0, 0.008, 0.016, 0.024)
"""Distances to the organ's surface [m]; at the last one the worth is 1."""
TUMOUR_KNOTS_M = (0.0, 0.004, 0.008, 0.012, 0.016)
"""Distances to the nearest label of tumour [m]; what lies farther away is nothing to outline."""
NEARER_KNOTS_M = (-0.008, 0.0, 0.008)
"""How much nearer the label of tumour lies than the nearest of none [m]; at the middle one the factor is 1."""
FOUND_M3 = 6e-6
"""Unit of the volume found [m^3]."""
N_SEARCH = len(CONE_KNOTS_M) - 1 + len(DEPTH_KNOTS_M) - 1 + 1
"""Number of features of a place to search."""
N_OUTLINE = len(TUMOUR_KNOTS_M) + len(NEARER_KNOTS_M) - 1
"""Number of features of a place to outline."""
_SEARCH_SPACING_M = 0.008
"""Places to search stand for cubes of this side [m], below the diameter of the tumours that are looked for."""
_MOST_OUTLINED = 400
"""Of more places to outline, every second, third, ... is taken."""


@dataclass(frozen=True, eq=False)
class Places:
    """Places that no cone has held, and what is known of each."""

    points_m: NDArray[np.float64]
    """The places [m, world], shape (P, 3)."""
    cell_m3: float
    """Volume for which each stands [m^3]."""
    features: NDArray[np.float64]
    """Their features, shape (P, `N_SEARCH`) or (P, `N_OUTLINE`)."""


@dataclass(frozen=True, eq=False)
class SearchLattice:
    """One search point for each cube of 8 mm, so that a search of a fine lattice costs no more than one of a coarse."""

    points_m: NDArray[np.float64]
    """The points [m, world], shape (S, 3)."""
    chosen: NDArray[np.intp]
    """Which of the search points they are, shape (S,)."""
    cell_m3: float
    """Volume for which each stands [m^3]."""


def search_lattice(points_m: NDArray[np.float64]) -> SearchLattice:
    """The thinned search points; kept, and returned again for the same array.

    Args:
        points_m: The search points [m, world], shape (M, 3).
    """
    return _search_lattice(KeyedArray(points_m))


@lru_cache(maxsize=2)
def _search_lattice(points: KeyedArray) -> SearchLattice:
    cubes = np.floor(points.array / _SEARCH_SPACING_M).astype(int)
    chosen = np.sort(np.unique(cubes, axis=0, return_index=True)[1])
    fine = fine_lattice(points.array)
    cell_m3 = fine.cell_m3 * len(fine.points_m) / len(chosen)
    return SearchLattice(np.ascontiguousarray(points.array[chosen]), chosen, cell_m3)


def hats(values: NDArray[np.float64], knots: tuple[float, ...]) -> NDArray[np.float64]:
    """The values of the hat functions over some knots, shape (n, k); they add up to 1, and end flat.

    Args:
        values: Where, shape (n,).
        knots: The knots, ascending.
    """
    return np.column_stack([np.interp(values, knots, row) for row in np.eye(len(knots))])


def features_of(situation: Situation) -> tuple[NDArray[np.float64], Places]:
    """The features of the points of the search lattice, shape (S, `N_SEARCH`), and the places to outline.

    Args:
        situation: What is known so far.
    """
    beside = _beside_tumour(situation)
    return _search_features(situation, beside.found_m3), _outline_places(situation, beside)


@dataclass(frozen=True, eq=False)
class _BesideTumour:
    """The fine points near labels of tumour."""

    points_m: NDArray[np.float64]
    to_tumour_m: NDArray[np.float64]
    """Distance to the nearest label of tumour [m], at most the last of `TUMOUR_KNOTS_M`."""
    cell_m3: float
    found_m3: float
    """The volume within 4 mm of labels of tumour [m^3]."""


def _beside_tumour(situation: Situation) -> _BesideTumour:
    lattice, most_m = fine_lattice(situation.search_points_m), TUMOUR_KNOTS_M[-1]
    rate = situation.false_positive_rate
    believed_m = (reading.believed_tumour_m(rate) for reading in situation.readings)
    tumour_m = np.concatenate([np.empty((0, 3)), *believed_m])
    points_m, gap_m = np.empty((0, 3)), np.empty(0)
    if len(tumour_m):
        points_m = _within(lattice.points_m, tumour_m, most_m)
        tree = KDTree(tumour_m, balanced_tree=False, compact_nodes=False)
        gap_m = tree.query(points_m, distance_upper_bound=most_m)[0]
        points_m, gap_m = points_m[gap_m <= most_m], gap_m[gap_m <= most_m]
    found_m3 = lattice.cell_m3 * float((gap_m <= TUMOUR_KNOTS_M[1]).sum())
    return _BesideTumour(points_m, gap_m, lattice.cell_m3, found_m3)


def _search_features(situation: Situation, found_m3: float) -> NDArray[np.float64]:
    lattice = search_lattice(situation.search_points_m)
    n = len(lattice.points_m)
    depth_m = np.full(n, np.inf)
    if situation.surface_distance_m is not None:
        depth_m = situation.surface_distance_m[lattice.chosen]
    gap_m = _distance_to_sensed(situation, lattice.points_m)
    found = np.full((n, 1), np.log1p(found_m3 / FOUND_M3))
    return np.hstack([hats(gap_m, CONE_KNOTS_M)[:, :-1], hats(depth_m, DEPTH_KNOTS_M)[:, :-1], found])


def _outline_places(situation: Situation, beside: _BesideTumour) -> Places:
    is_open = _distance_to_sensed(situation, beside.points_m) > 0.0
    step = max(1, -(-int(is_open.sum()) // _MOST_OUTLINED))
    points_m, to_tumour_m = beside.points_m[is_open][::step], beside.to_tumour_m[is_open][::step]
    if not len(points_m):
        return Places(points_m, beside.cell_m3, np.empty((0, N_OUTLINE)))
    nearer_m = _distance_to_free(situation, points_m) - to_tumour_m
    nearer = np.delete(hats(nearer_m, NEARER_KNOTS_M), 1, axis=1)
    features = np.hstack([hats(to_tumour_m, TUMOUR_KNOTS_M), nearer])
    return Places(points_m, step * beside.cell_m3, features)


def _distance_to_sensed(situation: Situation, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The distance of points to the nearest sensed cone [m], 0 or below within, shape (P,); infinite without one."""
    if not situation.sensed or not len(points_m):
        return np.full(len(points_m), np.inf)
    sensed = situation.workspace.part(situation.sensed)
    return distance_to_cones(sensed, situation.cone, points_m).min(axis=1).astype(np.float64)


def _distance_to_free(situation: Situation, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The distance of points to the nearest label of none [m], shape (P,); infinite beyond 24 mm."""
    most_m = TUMOUR_KNOTS_M[-1] + NEARER_KNOTS_M[-1]
    free_m = np.concatenate([reading.points_m[~reading.is_occupied] for reading in situation.readings])
    free_m = _within(free_m, points_m, most_m)
    if not len(free_m):
        return np.full(len(points_m), np.inf)
    tree = KDTree(free_m, balanced_tree=False, compact_nodes=False)
    return tree.query(points_m, distance_upper_bound=most_m)[0]


def _within(
    points_m: NDArray[np.float64], others_m: NDArray[np.float64], margin_m: float
) -> NDArray[np.float64]:
    """Those of some points that lie in the box around others, shape (P, 3)."""
    low_m, high_m = others_m.min(axis=0) - margin_m, others_m.max(axis=0) + margin_m
    return points_m[((points_m >= low_m) & (points_m <= high_m)).all(axis=1)]

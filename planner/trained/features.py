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
from ..find_and_outline.frontier import sensed_points
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


def search_features(situation: Situation) -> NDArray[np.float64]:
    """The features of the points of the search lattice, shape (S, `N_SEARCH`).

    Args:
        situation: What is known so far.
    """
    lattice = search_lattice(situation.search_points_m)
    n = len(lattice.points_m)
    gap_m = np.full(n, np.inf)
    if situation.sensed:
        sensed = situation.workspace.part(situation.sensed)
        gap_m = distance_to_cones(sensed, situation.cone, lattice.points_m).min(axis=1).astype(np.float64)
    depth_m = np.full(n, np.inf)
    if situation.surface_distance_m is not None:
        depth_m = situation.surface_distance_m[lattice.chosen]
    found = np.full((n, 1), np.log1p(_found_m3(situation) / FOUND_M3))
    return np.hstack([hats(gap_m, CONE_KNOTS_M)[:, :-1], hats(depth_m, DEPTH_KNOTS_M)[:, :-1], found])


def outline_places(situation: Situation) -> Places:
    """The places near labels of tumour that no cone has held, with their features.

    Args:
        situation: What is known so far.
    """
    lattice, tumour_m = fine_lattice(situation.search_points_m), tumour_labels_m(situation)
    near = lattice.near(tumour_m, TUMOUR_KNOTS_M[-1])
    near = near[~sensed_points(situation.workspace, situation.cone, situation.sensed, lattice.points_m[near])]
    step = max(1, -(-len(near) // _MOST_OUTLINED))
    points_m = lattice.points_m[near[::step]]
    if not len(points_m):
        return Places(np.empty((0, 3)), lattice.cell_m3, np.empty((0, N_OUTLINE)))
    to_tumour_m = KDTree(tumour_m).query(points_m)[0]
    nearer_m = _distance_to_free(situation, points_m) - to_tumour_m
    nearer = np.delete(hats(nearer_m, NEARER_KNOTS_M), 1, axis=1)
    features = np.hstack([hats(to_tumour_m, TUMOUR_KNOTS_M), nearer])
    return Places(points_m, step * lattice.cell_m3, features)


def tumour_labels_m(situation: Situation) -> NDArray[np.float64]:
    """The points of all readings that are believed to be tumour [m], shape (T, 3)."""
    rate = situation.false_positive_rate
    return np.concatenate(
        [np.empty((0, 3)), *(reading.believed_tumour_m(rate) for reading in situation.readings)]
    )


def _found_m3(situation: Situation) -> float:
    """The volume within 4 mm of labels of tumour [m^3]."""
    lattice = fine_lattice(situation.search_points_m)
    return lattice.cell_m3 * len(lattice.near(tumour_labels_m(situation), TUMOUR_KNOTS_M[1]))


def _distance_to_free(situation: Situation, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The distance of points to the nearest label of none [m], shape (P,), exact up to 24 mm; more is infinite."""
    most_m = TUMOUR_KNOTS_M[-1] + NEARER_KNOTS_M[-1]
    low_m, high_m = points_m.min(axis=0) - most_m, points_m.max(axis=0) + most_m
    free_m = np.concatenate([reading.points_m[~reading.is_occupied] for reading in situation.readings])
    free_m = free_m[((free_m >= low_m) & (free_m <= high_m)).all(axis=1)]
    if not len(free_m):
        return np.full(len(points_m), np.inf)
    tree = KDTree(free_m, balanced_tree=False, compact_nodes=False)
    return tree.query(points_m, distance_upper_bound=most_m)[0]

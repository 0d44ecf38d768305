"""Suspects: places that a view called tumour, of which the votes of all views have not decided yet.

A view that grazes a lesion, or the only one that does not miss it, labels a few points. The map may smooth them away
among those of a view that missed it, and a false blob stays in the map until another view looks. So what a view called
tumour is looked at again until the votes of the views (`mapping.votes`) confirm it or drop it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import expit

from mapping import votes

from ..situation import Situation

_PRIOR = 0.02
"""Probability of tumour at a place before any view, as in the map and in `LabelledPoints.believed_tumour_m`."""
_DROPPED, _CONFIRMED = 0.1, 0.99
"""Below the first probability a suspect is dropped: two views that miss a lesion as often as readers do outvote one
that saw it. Above the second it is confirmed: that takes two views."""
_LIKELY, _ENOUGH_VIEWS, _MOST_VIEWS = 0.5, 4, 8
"""What so many views spoke of, and did not decide, is no suspect any more: the first number where it is unlikely, the
second where it is likely. A lesion that two of four views missed would be given up otherwise."""
_AGREES_M = 0.0045
"""The map agrees with a vote where a place this near is likely [m]: the largest spacing of the places that it is asked
about."""
_REACH_M = 0.003
"""A suspect stands for the places this near to it [m]: half the diagonal of the cube below."""
_CUBE_M = 0.004
"""Of the labels in a cube of this side the first is asked [m]: about the spacing of a view's labels."""


@dataclass(frozen=True, eq=False)
class Suspects:
    """Places that are suspected to be tumour."""

    points_m: NDArray[np.float64]
    """The suspects [m], shape (S, 3)."""
    probability: NDArray[np.float64]
    """The probability that each is tumour, shape (S,)."""

    def chance_at(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The probability of the suspect that stands for each point [m], shape (N, 3); 0 where there is none."""
        chance = np.zeros(len(points_m))
        if len(points_m) and len(self.points_m):
            tree: Any = KDTree(self.points_m)
            gap_m, nearest = tree.query(points_m, distance_upper_bound=_REACH_M)
            is_near = np.isfinite(gap_m)
            chance[is_near] = self.probability[nearest[is_near]]
        return chance


def suspects(situation: Situation, likely_m: NDArray[np.float64], margin_m: float) -> Suspects:
    """What is suspected; nothing where views miss nothing.

    Labels of tumour that can be believed are suspects where votes and map have not decided and no confirmed place is
    near. A place is confirmed where the votes are sure and the map takes it, too, for likelier tumour than not: it may
    drown what two views that graze a lesion saw in what two others missed.

    Args:
        situation: What is known so far.
        likely_m: The places that the map takes for likelier tumour than not [m], shape (P, 3).
        margin_m: What counts as near [m].
    """
    called_m = [
        reading.believed_tumour_m(0.0) for reading in situation.readings if reading.weight is not None
    ]
    if situation.missed_rate == 0.0 or not called_m:
        return Suspects(np.empty((0, 3)), np.empty(0))
    points_m = _thinned(np.concatenate(called_m))
    log_odds, n_views = votes(points_m, situation.readings, _PRIOR)
    probability = expit(log_odds)
    n_enough = np.where(probability > _LIKELY, _MOST_VIEWS, _ENOUGH_VIEWS)
    is_confirmed = (probability >= _CONFIRMED) & _is_near(points_m, likely_m, _AGREES_M)
    is_suspect = (probability > _DROPPED) & ~is_confirmed & (n_views < n_enough)
    confirmed_m, suspect = points_m[is_confirmed], np.flatnonzero(is_suspect)
    suspect = suspect[~_is_near(points_m[suspect], confirmed_m, margin_m)]
    return Suspects(points_m[suspect], probability[suspect])


def _is_near(
    points_m: NDArray[np.float64], others_m: NDArray[np.float64], reach_m: float
) -> NDArray[np.bool_]:
    """Which points have one of the others within a reach, shape (N,)."""
    if not len(points_m) or not len(others_m):
        return np.zeros(len(points_m), dtype=bool)
    gap_m, _ = KDTree(others_m).query(points_m, distance_upper_bound=reach_m)
    return np.isfinite(gap_m)


def _thinned(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The first point in each cube."""
    _, first = np.unique(np.floor(points_m / _CUBE_M).astype(np.int64), axis=0, return_index=True)
    return points_m[np.sort(first)]

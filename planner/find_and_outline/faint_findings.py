"""Faint findings: lesions that the map calls in one place alone, at which one look more tells how far they reach.

A cone that holds a small lesion may have a single label in it. The map calls the place of that label, and nothing
beside it, so that what was found has no extent. Outlining goes by volume and leaves it for last, as little is to gain.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..situation import Situation
from ..visibility import visibility
from .fine_lattice import FineLattice
from .frontier import seen_weight
from .hidden_balls import point_spacing_m

_NEIGHBOUR = 1.8
"""Places within this many spacings are neighbours: those beside, across an edge, and across a corner."""
_AROUND_M = 0.004
"""What a look at a faint finding has to hold: all within this distance of it [m]."""
_ENOUGH_LOOKS = 3
"""A place that lay in this many cones is looked at no more for its own sake."""
_MOST_IN_VAIN = 4
"""Where more places than this were looked at so often and are still alone, labels are wrong, whatever is said of the
sensor: a lesion has an extent, unless it is as small as the lattice is fine."""


def faint_score(situation: Situation, lattice: FineLattice) -> NDArray[np.float64]:
    """The number of faint findings that each pose would look at again, shape (N,).

        faint = sum over faint findings f of  share of the places within 4 mm of f that lie in the pose's cone

    None where labels may be wrong, or where looks have been in vain so often that they must be: there, suspects and
    rims are looked at again.

    Args:
        situation: What is known so far.
        lattice: The fine points.
    """
    places_m = _faint_places_m(situation)
    if not len(places_m):
        return np.zeros(situation.workspace.n_poses)
    around = KDTree(lattice.points_m).query_ball_point(places_m, _AROUND_M)
    points_m = [
        np.vstack([place_m, lattice.points_m[near]]) for place_m, near in zip(places_m, around, strict=True)
    ]
    weights = np.concatenate([np.full(len(each), 1.0 / len(each)) for each in points_m])
    return seen_weight(situation.workspace, situation.cone, np.concatenate(points_m), weights)


def _faint_places_m(situation: Situation) -> NDArray[np.float64]:
    """The places that the map calls, without a neighbour that it calls, and that lay in few cones [m], shape (K, 3)."""
    may_err = max(situation.missed_rate, situation.false_positive_rate, situation.false_negative_rate) > 0.0
    if may_err or not situation.sensed:
        return np.empty((0, 3))
    points_m = situation.search_points_m
    called_m = points_m[situation.belief("find-and-outline").score > 0.0]
    if not len(called_m):
        return called_m
    tree: Any = KDTree(called_m)
    reach_m = _NEIGHBOUR * point_spacing_m(KDTree(points_m))
    n_near = tree.query_ball_point(called_m, reach_m, return_length=True)
    alone_m = called_m[n_near == 1]
    if not len(alone_m):
        return alone_m
    looks = visibility(situation.workspace.part(situation.sensed), situation.cone, alone_m).sum(axis=1)
    is_settled = looks >= _ENOUGH_LOOKS
    return alone_m[:0] if is_settled.sum() > _MOST_IN_VAIN else alone_m[~is_settled]

"""What the rates of a sensor's errors make of a reading: how far each label can be believed, and how much it counts.

Where single labels err by themselves, a label says as much as its rates:

    L = log((1 - p_-) / p_+)   of a label of tumour,      L = log(p_- / (1 - p_+))   of a free one.

Where a view misses whole lesions or invents some, its labels err together. Within `together_m` of a point they have
one cause, so that n of them count for one, by powers w = 1 / n of their likelihoods. And a label's chance to be wrong
is that its view errs about the place, or that it errs by itself:

    P(tumour | free)  = i + (1 - i) q_+       i: invented, q_+: by itself
    P(free | tumour)  = m + (1 - m) q_-       m: missed

A label that agrees with its neighbours is no slip of a single point: with k of the 8 nearest on its side, q is the
chance P(Binomial(8, p) >= k) that slips alone do that.

Outlines that stray need no chance of their own. Views that draw them apart from each other disagree near the edge, and
the map's latent crosses zero where they balance; to lower the odds of labels near an edge besides made maps worse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import bdtrc

from ..labelled_points import LabelledPoints
from ..likelihood import label_log_odds
from .error_rates import ErrorRates

N_NEIGHBOURS = 8
"""Points, the labelled one included, whose labels tell a slip from a finding."""
_LEAST_CHANCE = 1e-6
"""No label is believed beyond this chance of being wrong, where labels err at all."""


def judged(
    points_m: NDArray[np.float64], is_occupied: NDArray[np.bool_], rates: ErrorRates
) -> LabelledPoints:
    """The labels of a reading with how far each can be believed.

    Args:
        points_m: Points of one reading [m], shape (n, 3).
        is_occupied: Their labels, shape (n,).
        rates: How the sensor errs.
    """
    if not rates.err_together:
        log_odds = label_log_odds(is_occupied.astype(float), rates.false_positive, rates.false_negative)
        return LabelledPoints(points_m, is_occupied, log_odds)
    if not len(points_m):
        return LabelledPoints(points_m, is_occupied, np.empty(0), np.empty(0))
    slip = np.clip(_slips(points_m, is_occupied, rates), _LEAST_CHANCE, 0.5)
    # What is wrong of a label, and what the label is if its place is as it says.
    if_wrong = np.where(is_occupied, rates.invented, rates.missed)
    if_right = np.where(is_occupied, rates.missed, rates.invented)
    wrong = if_wrong + (1.0 - if_wrong) * slip
    right = (1.0 - if_right) * (1.0 - slip)
    log_odds = np.where(is_occupied, 1.0, -1.0) * np.maximum(np.log(right / wrong), 0.0)
    weight = 1.0 / n_together(points_m, is_occupied, rates.together_m)
    return LabelledPoints(points_m, is_occupied, log_odds, weight)


def n_agreeing(points_m: NDArray[np.float64], is_occupied: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many of the points nearest to each, itself included, have its label, shape (n,); from 1 to 8.

    Args:
        points_m: Points of one reading [m], shape (n, 3), n at least 1.
        is_occupied: Their labels, shape (n,).
    """
    n = min(N_NEIGHBOURS, len(points_m))
    # A list of neighbours keeps the shape (n, k) where k is 1; the stubs know only a number.
    _, nearest = KDTree(points_m).query(points_m, k=[*range(1, n + 1)])  # pyright: ignore[reportArgumentType]
    return (is_occupied[nearest] == is_occupied[:, None]).sum(axis=1)


def _slips(
    points_m: NDArray[np.float64], is_occupied: NDArray[np.bool_], rates: ErrorRates
) -> NDArray[np.float64]:
    """The chance that slips of single points explain each label and those that agree with it nearby, shape (n,)."""
    rate = np.where(is_occupied, rates.false_positive, rates.false_negative)
    return bdtrc(n_agreeing(points_m, is_occupied) - 1, min(N_NEIGHBOURS, len(points_m)), rate)


def n_together(
    points_m: NDArray[np.float64], is_occupied: NDArray[np.bool_], together_m: float
) -> NDArray[np.int64]:
    """The number of labels that agree with each within a distance, itself included, shape (n,).

    Args:
        points_m: Points of one reading [m], shape (n, 3).
        is_occupied: Their labels, shape (n,).
        together_m: The distance [m].
    """
    count = np.ones(len(points_m), dtype=np.int64)
    for kind in (True, False):
        own = np.flatnonzero(is_occupied == kind)
        if own.size:
            tree = KDTree(points_m[own])
            count[own] = tree.query_ball_point(points_m[own], together_m, return_length=True)
    return count

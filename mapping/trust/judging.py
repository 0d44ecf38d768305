"""What the rates of a sensor's errors make of a reading: how far each label can be believed, and how much it counts.

Where single labels err by themselves, a label says as much as its rates:

    L = log((1 - p_-) / p_+)   of a label of tumour,      L = log(p_- / (1 - p_+))   of a free one.

Where a view misses whole lesions or invents some, its labels err together. Of n labels within `together_m` whose errors
have the correlation rho each counts for w = 1 / (1 + (n - 1) rho), by a power of its likelihood: the design effect of
samples drawn in clusters (Kish 1965, section 5.4). All n count for one where they always err together, and for n where
they err each by itself. And a label's chance to be wrong is that its view errs about the place, or that it errs by
itself:

    P(tumour | free)  = i + (1 - i) q_+       i: invented, q_+: by itself
    P(free | tumour)  = m + (1 - m) q_-       m: missed

A label that agrees with its neighbours is no slip of a single point: with k of the 8 nearest on its side, q is the
chance P(Binomial(8, p) >= k) that slips alone do that.

Outlines that stray are heeded where a map asks near neighbours, see `near_tumour.outline`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..labelled_points import LabelledPoints
from ..likelihood import label_log_odds
from .error_rates import ErrorRates

_LEAST_CHANCE = 1e-6
"""No label is believed beyond this chance of being wrong, where labels err at all."""


def judged(reading: LabelledPoints, rates: ErrorRates) -> LabelledPoints:
    """A reading with how far each of its labels can be believed.

    Args:
        reading: Points of one view and their labels.
        rates: How the sensor errs.
    """
    is_tumour = reading.is_occupied
    if not rates.err_together:
        log_odds = label_log_odds(is_tumour.astype(float), rates.false_positive, rates.false_negative)
        return replace(reading, log_odds=log_odds)
    slip = reading.slip_chance(np.where(is_tumour, rates.false_positive, rates.false_negative))
    slip = np.clip(slip, _LEAST_CHANCE, 0.5)
    # The chance that a view errs about a place so that this label comes out, or so that the other one does.
    if_wrong = np.where(is_tumour, rates.invented, rates.missed)
    if_right = np.where(is_tumour, rates.missed, rates.invented)
    wrong = if_wrong + (1.0 - if_wrong) * slip
    right = (1.0 - if_right) * (1.0 - slip)
    log_odds = np.where(is_tumour, 1.0, -1.0) * np.maximum(np.log(right / wrong), 0.0)
    n = n_together(reading.points_m, is_tumour, rates.together_m)
    weight = 1.0 / (1.0 + (n - 1.0) * rates.correlation)
    return replace(reading, log_odds=log_odds, weight=weight)


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

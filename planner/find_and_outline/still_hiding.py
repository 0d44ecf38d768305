"""What the readings leave of the balls that could hide.

A point in a lesion that is called free was called so in error, so it leaves of a ball what its chance to be wrong is.
Where labels of a view err together, a lesion is missed as a whole, and a view leaves one chance, however many of its
labels lie in the ball: that of the label nearest to the ball's centre, which the outline's stray can explain least.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import ndtr

from mapping import LabelledPoints

from .hidden_balls import HiddenBalls

_READINGS_TOGETHER = 8
"""Readings that are looked up in one go, and whose result is kept as one."""
_STRAY_M = 0.0015
"""Standard deviation of an outline that a view draws [m]: 12 % of the radius of a lesion of 25 mm, as the map takes
it."""


def still_hiding(
    balls: HiddenBalls,
    readings: Sequence[LabelledPoints],
    false_negative_rate: float,
    false_positive_rate: float = 0.0,
) -> NDArray[np.float64]:
    """The weight of each ball in the light of the readings, shape (B,).

    Points inside a tumour are called tumour, so each point in a ball that was called free multiplies the ball's weight
    by the rate of such false labels. A ball that holds a point believed to be tumour is not hidden, and weighs nothing.

    Args:
        balls: The balls.
        readings: What each sensing action returned.
        false_negative_rate: Share of tumour points that the sensor is believed to call free.
        false_positive_rate: Share of free points that the sensor is believed to call tumour.
    """
    weights = balls.weights.astype(np.float64)
    for start in range(0, len(readings), _READINGS_TOGETHER):
        some = tuple(readings[start : start + _READINGS_TOGETHER])
        rates = false_negative_rate, false_positive_rate
        if all(reading.log_odds is not None for reading in some):
            # Such labels go by no rate, so that what is kept of them holds also when a rate was learnt anew.
            rates = 0.0, 0.0
        weights *= _left_by(balls, some, *rates)
    return weights


@lru_cache(maxsize=512)
def _left_by(
    balls: HiddenBalls,
    readings: tuple[LabelledPoints, ...],
    false_negative_rate: float,
    false_positive_rate: float,
) -> NDArray[np.float64]:
    """The share that some readings leave of each ball's weight, shape (B,); kept, since every action needs it again."""
    left = np.ones(len(balls.radii_m))
    tumour_m = [reading.believed_tumour_m(false_positive_rate) for reading in readings]
    if any(reading.log_odds is not None for reading in readings):
        return _left_by_doubtful(balls, readings, np.concatenate(tumour_m), false_negative_rate)
    free_m = [reading.points_m[~reading.is_occupied] for reading in readings]
    for points_m, rate in ((np.concatenate(tumour_m), 0.0), (np.concatenate(free_m), false_negative_rate)):
        if len(points_m):
            # Quick to build, since it answers one query.
            tree = KDTree(points_m, balanced_tree=False, compact_nodes=False)
            left *= rate ** tree.query_ball_point(balls.centres_m, balls.radii_m, return_length=True)
    return left


def _left_by_doubtful(
    balls: HiddenBalls,
    readings: tuple[LabelledPoints, ...],
    believed_m: NDArray[np.float64],
    false_negative_rate: float,
) -> NDArray[np.float64]:
    """The share that readings leave of each ball's weight where labels say how far they can be believed, shape (B,).

    Args:
        balls: The balls.
        readings: The readings.
        believed_m: Labels of tumour that can be believed [m], shape (T, 3).
        false_negative_rate: The same for labels of readings that do not say, as exp(L).
    """
    left = np.ones(len(balls.radii_m))
    with np.errstate(divide="ignore"):
        unsaid = np.log(false_negative_rate)
    for reading in readings:
        free = np.flatnonzero(~reading.is_occupied)
        if free.size:
            said = np.full(free.size, unsaid) if reading.log_odds is None else reading.log_odds[free]
            by_itself = reading.weight is None
            left *= (_left_by_labels if by_itself else _left_by_view)(balls, reading.points_m[free], said)
    if len(believed_m):
        tree = KDTree(believed_m)
        left[tree.query_ball_point(balls.centres_m, balls.radii_m, return_length=True) > 0] = 0.0
    return left


def _left_by_labels(
    balls: HiddenBalls, free_m: NDArray[np.float64], log_odds: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What free labels that err each by itself leave of each ball, exp(sum_n L_n), shape (B,)."""
    tree = KDTree(free_m, balanced_tree=False, compact_nodes=False)
    held = tree.query_ball_point(balls.centres_m, balls.radii_m)
    return np.exp([log_odds[each].sum() for each in held])


def _left_by_view(
    balls: HiddenBalls, free_m: NDArray[np.float64], log_odds: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What the free labels of a view that errs as a whole leave of each ball, shape (B,).

        e + (1 - e) Phi(-d / s),   e = exp(L)

    with L the log odds of the label in the ball that is nearest to its centre, d the distance of that label to the
    ball's surface, and s the stray of outlines: the view missed the lesion, or drew its edge beyond the label.
    """
    left, reach_m = np.ones(len(balls.radii_m)), float(balls.radii_m.max(initial=0.0))
    # The stubs take the neighbours of many places for one.
    tree: Any = KDTree(free_m, balanced_tree=False, compact_nodes=False)
    gap_m, nearest = tree.query(balls.centres_m, distance_upper_bound=reach_m)
    held = np.flatnonzero(gap_m <= balls.radii_m)
    missed = np.exp(np.minimum(log_odds[nearest[held]], 0.0))
    left[held] = missed + (1.0 - missed) * ndtr(-(balls.radii_m[held] - gap_m[held]) / _STRAY_M)
    return left

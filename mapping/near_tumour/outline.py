"""What labels near the outline that their own view draws are worth: the outline strays.

A view that calls points on both sides of an edge has not missed the lesion, nor does it call all about it tumour. What
may be wrong there is where it draws the edge. With a stray s of the outline, normal, a label at the distance d from the
drawn edge lies on the other side of the true one with the chance

    q = Phi(-d / s)

and its log odds are log((1 - q) / q), either way. The edge runs between labels: a label whose nearest one of the other
kind is D away, in a view whose labels lie g apart, has d = D - 3/4 g in the mean or more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import log_ndtr

from ..labelled_points import LabelledPoints

_NEAR_M = 0.010
"""Within this distance of an own label of the other kind, a label is one about an outline [m]: outlines stray over
about 10 mm in one go (docs/readers.md)."""
_BETWEEN = 0.75
"""Share of the labels' gap that lies between the edge and the nearest label of the other kind."""
_LEAST_AGREEING = 3
"""Labels, of the 8 nearest to one and itself included, that have its kind where it is no slip."""
_LEAST, _MOST = 0.02, 6.6
"""Least and most log odds that an outline gives a label: next to it a label says all but nothing, and far from it no
more than that a view seldom invents a lesion."""


def heeding_outline(reading: LabelledPoints, stray_m: float) -> LabelledPoints:
    """A reading whose labels near their own outline are worth what the outline is; others stay as they are.

    Labels of tumour, and slips, are never worth more than they were.

    Args:
        reading: The reading; one whose labels err each by itself is returned unchanged.
        stray_m: Standard deviation s of the outline [m], above 0.
    """
    log_odds, is_tumour = reading.log_odds, reading.is_occupied
    if log_odds is None or reading.weight is None or len(reading.points_m) < 2 or not is_tumour.any():
        return reading
    is_slip = reading.n_agreeing < _LEAST_AGREEING
    apart_m = _apart_m(reading.points_m, is_tumour, is_slip)
    gap_m = float(np.median(reading.tree.query(reading.points_m, k=2)[0][:, 1]))
    depth = np.maximum(apart_m - _BETWEEN * gap_m, 0.0) / stray_m
    size = np.clip(log_ndtr(depth) - log_ndtr(-depth), _LEAST, _MOST)
    may_rise = ~is_tumour & ~is_slip
    size = np.where(may_rise, size, np.minimum(size, np.abs(log_odds)))
    told = np.where(apart_m < _NEAR_M, np.where(is_tumour, size, -size), log_odds)
    return replace(reading, log_odds=told)


def _apart_m(
    points_m: NDArray[np.float64], is_tumour: NDArray[np.bool_], is_slip: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """The distance of each label to the nearest of the other kind that is no slip [m], infinite without one."""
    apart_m = np.full(len(points_m), np.inf)
    for kind in (True, False):
        own, other = is_tumour == kind, (is_tumour != kind) & ~is_slip
        if own.any() and other.any():
            apart_m[own] = KDTree(points_m[other]).query(points_m[own], distance_upper_bound=_NEAR_M)[0]
    return apart_m

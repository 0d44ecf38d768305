"""What all views together say of a place, each by the label of it that is nearest: one vote a view.

Where a view misses or sees a lesion as a whole, its labels about a place have one cause, and it has one vote however
many they are. With the log odds L_t of view t's nearest label, and a prior, the log odds of tumour are

    V(x) = logit(prior) + sum over the views t with a label near x of  L_t(x)

No kernel smooths them. A map carries what it knows from place to place, and so drowns the few labels of a view that
grazes a lesion in the many of one that missed it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit

from ..labelled_points import LabelledPoints

_SPEAKS_M = 0.005
"""A view speaks of a place to which a label of it is this near [m]: somewhat more than labels of one view lie apart."""


def votes(
    points_m: NDArray[np.float64], readings: Sequence[LabelledPoints], prior: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The log odds of tumour at places by the votes of the views, and how many views speak of each, shapes (N,).

    Args:
        points_m: The places [m], shape (N, 3).
        readings: What the views returned, with how far labels can be believed; others have no vote.
        prior: The probability of tumour before any view.
    """
    log_odds, n_views = np.full(len(points_m), float(logit(prior))), np.zeros(len(points_m), dtype=np.int64)
    for reading in readings:
        if reading.log_odds is None or not len(reading.points_m):
            continue
        low_m, high_m = reading.bounds_m
        is_close = ((points_m >= low_m - _SPEAKS_M) & (points_m <= high_m + _SPEAKS_M)).all(axis=1)
        close = np.flatnonzero(is_close)
        if close.size:
            gap_m, nearest = reading.tree.query(points_m[close], distance_upper_bound=_SPEAKS_M)
            is_near = np.isfinite(gap_m)
            log_odds[close[is_near]] += reading.log_odds[nearest[is_near]]
            n_views[close[is_near]] += 1
    return log_odds, n_views

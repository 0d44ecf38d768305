"""How far an episode trusts the labels of its sensor: by rates that are told, or learnt as readings come.

Rates are learnt by empirical Bayes. A rate r of the prior Beta(r_0 n_0, (1 - r_0) n_0) has, after k errors in n cases,
the mean (r_0 n_0 + k) / (n_0 + n). What counts as an error:

- A single point slips where all but one at most of its 7 neighbours say otherwise; the points with such neighbours are
  the cases.
- A view misses a place where the map is sure of tumour and the view is sure that it is free; it invents one the other
  way round. A view is sure of a point with whose label all neighbours agree, for tumour some: lesions may be small. The
  map is sure of what most views say, so that repeated views decide. Labels that err together count for one case.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..labelled_points import CHANCE, N_NEIGHBOURS, LabelledPoints
from ..prediction import Prediction
from .error_rates import ErrorRates
from .judging import judged, n_together
from .settings import TrustSettings

_CASES = {"false_positive": 200.0, "false_negative": 50.0, "missed": 5.0, "invented": 1000.0}
"""How many cases the prior of each rate counts for."""
_SURE_TUMOUR, _SURE_FREE = 0.9, 0.02
"""Probabilities beyond which the map is sure of a place."""
_BESIDE_M = 0.008
"""Labels of tumour within this distance of likely tumour belong to it [m]."""
_LEAST_AGREEING = 3
"""Labels of tumour, among the 8 nearest to one, that are no slips together where slips are rare."""
_MOST = 0.45
"""No rate is learnt to be larger: from one half on labels would say nothing, or the opposite."""


@dataclass(frozen=True)
class _Counts:
    """Errors and cases of one rate."""

    errors: float = 0.0
    cases: float = 0.0

    def with_more(
        self,
        is_case: NDArray[np.bool_],
        is_error: NDArray[np.bool_],
        weight: NDArray[np.float64] | float = 1.0,
    ) -> _Counts:
        """The counts with those of more labels, each of which counts for `weight` cases."""
        counts = np.broadcast_to(weight, is_case.shape)
        errors, cases = (float(counts[each].sum()) for each in (is_case & is_error, is_case))
        return _Counts(self.errors + errors, self.cases + cases)


@dataclass(frozen=True, eq=False)
class _View:
    """What one reading says of places."""

    points_m: NDArray[np.float64]
    """Where the view is sure of what it says [m], shape (n, 3)."""
    place: NDArray[np.intp]
    """The place next to each label, shape (n,)."""
    is_tumour: NDArray[np.bool_]
    """What the view says of it, shape (n,)."""
    weight: NDArray[np.float64]
    """How many cases each counts for, shape (n,)."""


class LabelTrust:
    """The rates at which the sensor of one episode is believed to err; `observe` learns them."""

    def __init__(self, settings: TrustSettings | None) -> None:
        """Begins with the rates that are told or expected.

        Args:
            settings: How labels are trusted; None to take them as they are, which learns nothing.
        """
        self.is_exact = settings is None
        self._prior = ErrorRates() if settings is None else settings.rates
        self.learns = settings is not None and settings.learns
        self.rates = self._prior
        self._counts = dict.fromkeys(_CASES, _Counts())
        self._views: list[_View] = []
        self._place_tree: KDTree | None = None

    def judge(self, reading: LabelledPoints) -> LabelledPoints:
        """A reading with how far each of its labels can be believed; what it tells itself is kept.

        Args:
            reading: What the sensor returned.
        """
        if self.is_exact or reading.log_odds is not None:
            return reading
        if self.learns:
            self._count_slips(reading)
            self._learn()
        return judged(reading, self.rates)

    def observe(self, reading: LabelledPoints, points_m: NDArray[np.float64], prediction: Prediction) -> None:
        """Learns from what all readings so far, the last one included, say of the places of which the map is sure.

        Args:
            reading: The last reading.
            points_m: The places [m], shape (M, 3), the same ones every time.
            prediction: What the map says of them by now.
        """
        if not self.learns:
            return
        if self._place_tree is None:
            self._place_tree = KDTree(points_m)
        if len(reading.points_m) >= N_NEIGHBOURS:
            self._views.append(_view(reading, self._place_tree, self.rates))
        self._count_views(points_m, prediction.probability)
        self._learn()

    def _count_slips(self, reading: LabelledPoints) -> None:
        """Counts the labels with whom hardly a neighbour agrees, and all points with such neighbours."""
        if len(reading.points_m) < N_NEIGHBOURS:
            return
        n_others = reading.n_agreeing - 1
        n_tumour = np.where(reading.is_occupied, n_others, N_NEIGHBOURS - 1 - n_others)
        for name, is_slip, n_against in (
            ("false_positive", reading.is_occupied, N_NEIGHBOURS - 1 - n_tumour),
            ("false_negative", ~reading.is_occupied, n_tumour),
        ):
            is_case = n_against >= N_NEIGHBOURS - 2
            self._counts[name] = self._counts[name].with_more(is_case, is_slip)

    def _count_views(self, points_m: NDArray[np.float64], probability: NDArray[np.float64]) -> None:
        """Counts anew what all views missed and invented, by what the map is sure of now."""
        missed, invented = _Counts(), _Counts()
        likely_m = points_m[probability > 0.5]
        likely = KDTree(likely_m) if len(likely_m) else None
        for view in self._views:
            chance = probability[view.place]
            missed = missed.with_more(chance > _SURE_TUMOUR, ~view.is_tumour, view.weight)
            is_free = chance < _SURE_FREE
            if likely is not None:
                # Outlines stray a little: what lies beside a lesion is not invented.
                called = np.flatnonzero(view.is_tumour & is_free)
                gap_m, _ = likely.query(view.points_m[called], distance_upper_bound=_BESIDE_M)
                is_free[called[np.isfinite(gap_m)]] = False
            invented = invented.with_more(is_free, view.is_tumour, view.weight)
        self._counts |= {"missed": missed, "invented": invented}

    def _learn(self) -> None:
        """Sets each rate to its posterior mean, below one half."""
        means = {
            name: (getattr(self._prior, name) * n + self._counts[name].errors)
            / (n + self._counts[name].cases)
            for name, n in _CASES.items()
        }
        self.rates = replace(self._prior, **{name: min(mean, _MOST) for name, mean in means.items()})


def _view(reading: LabelledPoints, places: KDTree, rates: ErrorRates) -> _View:
    """What a reading says of the places next to those of its labels of which it is sure."""
    is_tumour = reading.is_occupied
    # Slips of free points make small clusters by chance, and the more of them the larger.
    is_cluster = reading.slip_chance(rates.false_positive) < CHANCE
    is_cluster &= reading.n_agreeing >= _LEAST_AGREEING
    is_sure = np.where(is_tumour, is_cluster, reading.n_agreeing == N_NEIGHBOURS)
    points_m, is_tumour = reading.points_m[is_sure], is_tumour[is_sure]
    weight = 1.0 / n_together(points_m, is_tumour, rates.together_m)
    return _View(points_m, np.asarray(places.query(points_m)[1], dtype=np.intp), is_tumour, weight)

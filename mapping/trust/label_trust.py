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
from scipy.special import bdtrc

from ..labelled_points import LabelledPoints
from ..prediction import Prediction
from .error_rates import ErrorRates
from .judging import N_NEIGHBOURS, judged, n_agreeing, n_together
from .settings import TrustSettings

_CASES = {"false_positive": 200.0, "false_negative": 50.0, "missed": 5.0, "invented": 1000.0}
"""How many cases the prior of each rate counts for."""
_SURE_TUMOUR, _SURE_FREE = 0.9, 0.02
"""Probabilities beyond which the map is sure of a place."""
_BESIDE_M = 0.008
"""Labels of tumour within this distance of likely tumour belong to it [m]."""
_LEAST_AGREEING = 3
"""Labels of tumour, among the 8 nearest to one, that are no slips together where slips are rare."""
_CHANCE = 1e-3
"""Slips that make a cluster less often than this are not what made it."""


@dataclass(frozen=True)
class _Counts:
    """Errors and cases of one rate."""

    errors: float = 0.0
    cases: float = 0.0


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
        self._slips = {True: _Counts(), False: _Counts()}
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
            self._update_rates(missed=None, invented=None)
        return judged(reading.points_m, reading.is_occupied, self.rates)

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
        missed, invented, probability = _Counts(), _Counts(), prediction.probability
        likely_m = points_m[probability > 0.5]
        likely = KDTree(likely_m) if len(likely_m) else None
        for view in self._views:
            chance = probability[view.place]
            is_tumour = view.is_tumour
            missed = _added(missed, chance > _SURE_TUMOUR, ~is_tumour, view.weight)
            is_free = chance < _SURE_FREE
            if likely is not None:
                # Outlines stray a little: what lies beside a lesion is not invented.
                called = np.flatnonzero(is_tumour & is_free)
                gap_m, _ = likely.query(view.points_m[called], distance_upper_bound=_BESIDE_M)
                is_free[called[np.isfinite(gap_m)]] = False
            invented = _added(invented, is_free, is_tumour, view.weight)
        self._update_rates(missed=missed, invented=invented)

    def _count_slips(self, reading: LabelledPoints) -> None:
        """Counts the labels with whom hardly a neighbour agrees, and all points with such neighbours."""
        if len(reading.points_m) < N_NEIGHBOURS:
            return
        n_others = n_agreeing(reading.points_m, reading.is_occupied) - 1
        n_tumour = np.where(reading.is_occupied, n_others, N_NEIGHBOURS - 1 - n_others)
        for is_tumour in (True, False):
            # A label of tumour is a slip among free points, and the other way round.
            n_against = N_NEIGHBOURS - 1 - n_tumour if is_tumour else n_tumour
            is_case = n_against >= N_NEIGHBOURS - 2
            is_slip = is_case & (reading.is_occupied == is_tumour)
            counts = self._slips[is_tumour]
            self._slips[is_tumour] = _Counts(
                counts.errors + float(is_slip.sum()), counts.cases + float(is_case.sum())
            )

    def _update_rates(self, *, missed: _Counts | None, invented: _Counts | None) -> None:
        counts = {
            "false_positive": self._slips[True],
            "false_negative": self._slips[False],
            "missed": missed,
            "invented": invented,
        }
        self.rates = replace(
            self.rates,
            **{name: self._mean(name, each) for name, each in counts.items() if each is not None},
        )

    def _mean(self, name: str, counts: _Counts) -> float:
        """The posterior mean of a rate, kept below one half."""
        n = _CASES[name]
        return min((getattr(self._prior, name) * n + counts.errors) / (n + counts.cases), 0.45)


def _view(reading: LabelledPoints, places: KDTree, rates: ErrorRates) -> _View:
    """What a reading says of the places next to those of its labels of which it is sure."""
    is_tumour = reading.is_occupied
    agreeing = n_agreeing(reading.points_m, is_tumour)
    # Slips of free points make small clusters by chance, and the more of them the larger.
    is_cluster = (agreeing >= _LEAST_AGREEING) & (
        bdtrc(agreeing - 1, N_NEIGHBOURS, rates.false_positive) < _CHANCE
    )
    is_sure = np.where(is_tumour, is_cluster, agreeing == N_NEIGHBOURS)
    points_m, is_tumour = reading.points_m[is_sure], is_tumour[is_sure]
    weight = 1.0 / n_together(points_m, is_tumour, rates.together_m)
    return _View(points_m, np.asarray(places.query(points_m)[1], dtype=np.intp), is_tumour, weight)


def _added(
    counts: _Counts, is_case: NDArray[np.bool_], is_error: NDArray[np.bool_], weight: NDArray[np.float64]
) -> _Counts:
    return _Counts(
        counts.errors + float(weight[is_case & is_error].sum()), counts.cases + float(weight[is_case].sum())
    )

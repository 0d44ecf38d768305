"""A Hilbert map with finer ones laid into it wherever tumour was sensed.

A kernel is a compromise: as wide as the coarse map's it carries what a reading says to where the next one will be, and
smooths away a tumour no wider than itself. So around each cluster of points that were called tumour lies a box with
hinges of its own, closer together and narrower in the same ratio, which learns from the same readings and answers for
the points inside. Outside the boxes the coarse map answers; with no tumour sensed there is nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .belief.base import UpdateReport
from .boxes import Box, boxes_around
from .hilbert_map import HilbertMap
from .labelled_points import LabelledPoints
from .lattice import Lattice, check_points
from .prediction import Prediction
from .settings import MapSettings


@dataclass(frozen=True, kw_only=True)
class InsetSettings:
    """Of the finer maps."""

    hinge_spacing_m: float = 0.005625
    """Distance between neighbouring hinges [m], half of the coarse map's; gamma follows from it."""
    margin_m: float = 0.008
    """A box reaches at least this far beyond the points called tumour [m]."""
    tolerance: float = 3e-5
    """As `MapSettings.tolerance`; what the narrower kernel itself leaves open is far more."""
    max_hinges: int = 2000
    """A box that would need more gets hinges farther apart; from the coarse map's spacing on it is left out."""

    def __post_init__(self) -> None:
        """Checks the ranges."""
        for name in ("hinge_spacing_m", "margin_m"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be positive and finite, not {getattr(self, name)}")
        if not 0.0 <= self.tolerance <= 0.1:
            raise ValueError(f"tolerance must lie between 0 (exact) and 0.1, not {self.tolerance}")
        if self.max_hinges < 1:
            raise ValueError(f"max_hinges must be at least 1, not {self.max_hinges}")


@dataclass(frozen=True, eq=False)
class _Inset:
    fine: HilbertMap
    reach_m: float
    """The box's hinges reach this far beyond it, and it learns from points as far out [m]."""
    answers: NDArray[np.intp]
    """For which of the points that `predict_lattice` answers for, ascending."""


class DetailedMap:
    """Belief over where an organ is occupied by tumour, finer where tumour was sensed; `update` changes it."""

    def __init__(self, coarse: HilbertMap, settings: InsetSettings | None = None) -> None:
        """Lays nothing into a map yet.

        Args:
            coarse: A map with a query lattice and without readings.
            settings: Of the finer maps; the defaults if None.
        """
        self.coarse = coarse
        self._settings = settings if settings is not None else InsetSettings()
        self._readings: list[LabelledPoints] = []
        self._tumour_m = np.empty((0, 3))
        self._insets: dict[Box, _Inset | None] = {}

    @property
    def settings(self) -> MapSettings:
        """Of the coarse map."""
        return self.coarse.settings

    @property
    def boxes(self) -> list[Box]:
        """Where finer maps lie."""
        return [box for box, inset in self._insets.items() if inset is not None]

    @property
    def n_weights(self) -> int:
        """Number of hinges, those of the finer maps included."""
        fine = [inset.fine.n_weights for inset in self._insets.values() if inset is not None]
        return self.coarse.n_weights + sum(fine)

    def update(self, points_m: ArrayLike, is_occupied: ArrayLike) -> UpdateReport:
        """Takes in a reading, as `HilbertMap.update`; the report is the coarse map's."""
        report = self.coarse.update(points_m, is_occupied)
        reading = LabelledPoints(check_points(points_m), np.asarray(is_occupied, dtype=bool))
        self._readings.append(reading)
        tumour_m = reading.believed_tumour_m(self.settings.false_positive_rate)
        self._tumour_m = np.concatenate([self._tumour_m, tumour_m])
        before, self._insets = self._insets, {}
        step_m = 2.0 * self._settings.hinge_spacing_m
        for box in boxes_around(self._tumour_m, margin_m=self._settings.margin_m, step_m=step_m):
            if box in before:
                self._insets[box] = before[box]
                _learn(self._insets[box], box, reading)
            else:
                self._insets[box] = self._lay_in(box)
                for earlier in self._readings:
                    _learn(self._insets[box], box, earlier)
                _settle(self._insets[box])
        return report

    def revise(self, n_sweeps: int = 1) -> float:
        """Fits every reading again, as `HilbertMap.revise`, in the finer maps too; the largest change of all."""
        fine = [inset.fine for inset in self._insets.values() if inset is not None]
        return max(each.revise(n_sweeps) for each in (self.coarse, *fine))

    def predict(self, points_m: ArrayLike) -> Prediction:
        """The belief at any points [m], shape (N, 3)."""
        points = check_points(points_m)
        prediction = self.coarse.predict(points)
        mean, variance = prediction.latent_mean.copy(), prediction.latent_variance.copy()
        for box, inset in self._insets.items():
            inside = box.holds(points)
            if inset is not None and inside.any():
                fine = inset.fine.predict(points[inside])
                mean[inside], variance[inside] = fine.latent_mean, fine.latent_variance
        return Prediction(mean, variance)

    def predict_lattice(self) -> Prediction:
        """The belief at the points of the query lattice that its mask keeps, in C order."""
        prediction = self.coarse.predict_lattice()
        mean, variance = prediction.latent_mean.copy(), prediction.latent_variance.copy()
        for inset in self._insets.values():
            if inset is not None:
                fine = inset.fine.predict_lattice()
                mean[inset.answers], variance[inset.answers] = fine.latent_mean, fine.latent_variance
        return Prediction(mean, variance)

    def query_points_m(self) -> NDArray[np.float64]:
        """The points [m] that `predict_lattice` answers for, shape (N, 3)."""
        return self.coarse.query_points_m()

    def _lay_in(self, box: Box) -> _Inset | None:
        """The finer map of a box without readings; None where it would be no finer or answer for nothing."""
        coarse_m = self.settings.hinge_spacing_m
        spacing_m = self._settings.hinge_spacing_m
        while True:
            hinges = Lattice.from_box(box.low_m - spacing_m, box.high_m + spacing_m, spacing_m=spacing_m)
            if hinges.n_points <= self._settings.max_hinges or spacing_m >= coarse_m:
                break
            spacing_m *= 1.1
        inside = self.coarse.query_box(box.low_m, box.high_m)
        if spacing_m >= coarse_m or inside is None:
            return None
        gamma = self.settings.gamma_per_m2 * (coarse_m / spacing_m) ** 2
        settings = replace(
            self.settings,
            hinge_spacing_m=spacing_m,
            gamma_per_m2=gamma,
            tolerance=max(self._settings.tolerance, self.settings.tolerance),
        )
        fine = HilbertMap(hinges, settings, query=inside.lattice, query_mask=inside.mask)
        return _Inset(fine, spacing_m, inside.indices)


def _learn(inset: _Inset | None, box: Box, reading: LabelledPoints) -> None:
    """Takes the part of a reading that lies within a box's reach into its map."""
    if inset is None:
        return
    near = box.holds(reading.points_m, inset.reach_m)
    if near.any():
        inset.fine.update(reading.points_m[near], reading.is_occupied[near])


def _settle(inset: _Inset | None) -> None:
    """Fits the readings that a map was laid in with again: the first were taken in without knowing of the others."""
    if inset is not None and inset.fine.settings.form != "diagonal":
        inset.fine.revise()

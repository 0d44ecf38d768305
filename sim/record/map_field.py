"""A map as a field of log-odds on its lattice, which can be refined, thresholded and cut out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates, spline_filter
from scipy.special import logit

Axes = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
SURE = 1e-7
"""Probabilities are kept this far from 0 and 1, whose log-odds are infinite."""
CALLED_FROM = 0.5
"""The probability from which a map calls a point tumour: it is then more likely tumour than not."""
SPLINE_RIM = 12
"""Points that SciPy adds around values before it makes a spline of them that ends flat."""
ABOVE_PRIOR = 0.2
"""How much likelier than the prior a point has to be, where the prior would raise that probability."""


@dataclass(frozen=True, eq=False)
class MapField:
    """Log-odds of tumour at the points of a lattice, world frame."""

    axes_m: Axes
    """Coordinates along x, y and z [m]."""
    log_odds: NDArray[np.float64]
    """Log-odds of tumour, shape (X, Y, Z); outside the organ those of the nearest point inside."""
    is_inside: NDArray[np.bool_]
    """Which points lie in the organ, shape (X, Y, Z)."""
    is_tumour: NDArray[np.bool_]
    """Which points lie in a tumour in truth, shape (X, Y, Z)."""

    @classmethod
    def from_probability(
        cls,
        axes_m: Axes,
        probability: NDArray[np.floating],
        is_inside: NDArray[np.bool_],
        is_tumour: NDArray[np.bool_],
    ) -> MapField:
        """The field of a map's probabilities, which may be NaN outside the organ; all arrays have shape (X, Y, Z)."""
        if probability.shape != tuple(len(axis) for axis in axes_m) or probability.shape != is_inside.shape:
            raise ValueError(f"a map of shape {probability.shape} does not fit its axes")
        if not is_inside.any() or not np.isfinite(probability[is_inside]).all():
            raise ValueError("a map needs a finite probability at every point inside the organ")
        filled = np.where(is_inside, probability, 0.5).astype(np.float64)
        log_odds = extended(logit(np.clip(filled, SURE, 1.0 - SURE)), is_inside)
        return cls(axes_m, log_odds, is_inside, is_tumour)

    @property
    def n_inside(self) -> int:
        """The number of points in the organ."""
        return int(self.is_inside.sum())

    @property
    def low_m(self) -> NDArray[np.float64]:
        """The first point of the lattice [m], shape (3,)."""
        return np.array([axis[0] for axis in self.axes_m])

    @property
    def cell_m(self) -> NDArray[np.float64]:
        """The spacing along each axis [m], shape (3,); 0 along an axis of one point."""
        return np.array([axis[1] - axis[0] if len(axis) > 1 else 0.0 for axis in self.axes_m])

    def indices_of(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The fractional indices of points, shape (N, 3)."""
        cell_m = np.where(self.cell_m > 0, self.cell_m, 1.0)
        return (points_m - self.low_m) / cell_m

    def nearest(self, points_m: NDArray[np.float64]) -> NDArray[np.intp]:
        """The indices of the lattice point nearest to each point, shape (N, 3)."""
        rounded = np.rint(self.indices_of(points_m)).astype(np.intp)
        return np.clip(rounded, 0, np.array(self.log_odds.shape) - 1)

    def at(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The log-odds between the lattice's points by cubic interpolation, shape (N,)."""
        places = self.indices_of(points_m).T + SPLINE_RIM
        return map_coordinates(self._spline, places, order=3, mode="nearest", prefilter=False)

    @cached_property
    def _spline(self) -> NDArray[np.float64]:
        """The spline's coefficients, with a rim; `map_coordinates` itself would make the same ones each time."""
        return spline_filter(np.pad(self.log_odds, SPLINE_RIM, mode="edge"), order=3, mode="nearest")


def extended(values: NDArray[np.float64], is_inside: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The values, with that of the nearest point inside in the place of each outside, shape (X, Y, Z)."""
    _, nearest = distance_transform_edt(~is_inside, return_indices=True)  # pyright: ignore[reportGeneralTypeIssues]
    return values[tuple(nearest)]


def called_from(prior_prevalence: float) -> float:
    """The probability from which a map calls a point tumour.

    Args:
        prior_prevalence: Share of the organ that the map expects to be tumour before anything is sensed. Where that is
            a half, as in the paper, all that was never sensed would be called tumour from 0.5 on.
    """
    if prior_prevalence <= CALLED_FROM - ABOVE_PRIOR:
        return CALLED_FROM
    return min(prior_prevalence + ABOVE_PRIOR, 0.95)

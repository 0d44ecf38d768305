"""The weights' belief as variances alone, the paper's 1 x M form: fast, but it counts overlapping evidence
many times.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .belief import Belief, UpdateReport
from .kernel import AxisFeatures, HingeFeatures, contract, outer_features
from .lattice import Lattice
from .likelihood import bound_curvature
from .settings import MapSettings


class DiagonalBelief(Belief):
    """Independent Gaussian belief over each weight."""

    def __init__(self, features: HingeFeatures, settings: MapSettings) -> None:
        """Starts at zero mean and one variance."""
        self._features = features
        self._settings = settings
        self.mean = np.zeros(features.n_weights)
        self.variance = np.full(features.n_weights, settings.weight_variance)

    def learn(
        self, points_m: NDArray[np.float64], offset: NDArray[np.float64], is_occupied: NDArray[np.float64]
    ) -> UpdateReport:
        """Takes in a reading.

        1 / s'_j = 1 / s_j + 2 sum_n lambda_n phi_nj^2,  mu'_j = s'_j (mu_j / s_j + sum_n phi_nj (y_n - 1/2
        - 2 lambda_n b_n))
        """
        Phi, weights = self._local_features(points_m)
        squares = Phi**2
        prior_mean, prior_variance = self.mean[weights], self.variance[weights]
        mean, variance = prior_mean, prior_variance
        for _ in range(self._settings.n_em_iterations):
            curvature = bound_curvature(np.sqrt(squares @ variance + (offset + Phi @ mean) ** 2))
            variance = 1 / (1 / prior_variance + 2 * curvature @ squares)
            mean = variance * (
                prior_mean / prior_variance + (is_occupied - 0.5 - 2 * curvature * offset) @ Phi
            )
        self.mean[weights], self.variance[weights] = mean, variance
        return UpdateReport(
            n_points=len(points_m),
            n_occupied=int(is_occupied.sum()),
            rank=len(weights),
            n_weights_touched=len(weights),
        )

    def variance_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """Returns the variance at all points of a lattice."""
        squares = AxisFeatures(*(factor**2 for factor in self._features.on_lattice(query)))
        return contract(squares, self._features.over_hinges(self.variance)).ravel()

    def variance_near(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the variance at points that lie close together."""
        Phi, weights = self._local_features(points_m)
        return Phi**2 @ self.variance[weights]

    def _local_features(self, points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        box = self._features.box_around(points_m, self._settings.tolerance)
        weights = self._features.weights_in(box)
        Phi = outer_features(self._features.along_axes(points_m, box))
        return (Phi, weights) if np.all(weights >= 0) else (Phi[:, weights >= 0], weights[weights >= 0])

"""The belief over the weights as their variances, the paper's 1 x M form: fast, but it counts points many times.

The paper gives Sigma_t the shape 1 x M. Taken literally, the weights are independent, and each of the overlapping
features that a point touches learns from it as if it were the only one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..kernel import AxisFeatures, HingeFeatures, contract, outer_features
from ..lattice import Lattice
from ..likelihood import Evidence, agreed_mean, bound_curvature, expected_label
from ..settings import MapSettings
from ..storage import checked_array
from .belief import Belief, LearningReport


class DiagonalBelief(Belief):
    """Independent Gaussian belief over each weight."""

    def __init__(self, features: HingeFeatures, settings: MapSettings) -> None:
        """Starts at zero mean and one variance."""
        self._features = features
        self._settings = settings
        self.mean = np.zeros(features.n_weights)
        self._standard: NDArray[np.float64] | None = None
        self.variance = np.full(features.n_weights, settings.weight_variance)

    def learn(
        self, points_m: NDArray[np.float64], offset: NDArray[np.float64], evidence: Evidence
    ) -> LearningReport:
        """Takes in a reading; see `Belief.learn`.

        1 / s'_j = 1 / s_j + 2 sum_n w_n lambda_n phi_nj^2
        mu'_j    = s'_j (mu_j / s_j + sum_n w_n phi_nj (y_n - 1/2 - 2 lambda_n b_n))
        """
        Phi, weights = self._local_features(points_m)
        squares = Phi**2
        prior_mean, prior_variance = self.mean[weights], self.variance[weights]
        mean, variance, weight = prior_mean, prior_variance, evidence.weight
        labels = expected_label(0.0, evidence.log_odds)
        latent_mean = agreed_mean(offset + Phi @ mean, labels)
        curvature = np.zeros(len(points_m))
        for _ in range(self._settings.n_em_iterations):
            curvature = bound_curvature(np.sqrt(squares @ variance + latent_mean**2))
            variance = 1 / (1 / prior_variance + 2 * (weight * curvature) @ squares)
            gradient = weight * (labels - 0.5 - 2 * curvature * offset)
            mean = variance * (prior_mean / prior_variance + gradient @ Phi)
            latent_mean = offset + Phi @ mean
            labels = expected_label(latent_mean, evidence.log_odds)
        self.mean[weights], self.variance[weights] = mean, variance
        return LearningReport(len(weights), len(weights), curvature)

    def revise(self) -> float:
        """Refuses: the diagonal form keeps no readings."""
        raise ValueError("the diagonal form cannot revise its readings; use form='full' or form='local'")

    def settle(self) -> None:
        """See `Belief.settle`; nothing is put off."""

    def carry_samples(self, n_samples: int, rng: np.random.Generator) -> None:
        """Draws standard normal weights once; the belief's mean and variances scale them, now and later."""
        self._standard = rng.standard_normal((len(self.mean), n_samples))

    @property
    def samples(self) -> NDArray[np.float64]:
        """The carried draws of the weights, shape (M, S); see `Belief.samples`."""
        if self._standard is None:
            raise ValueError("no samples are carried; call carry_samples(n_samples, rng=rng) first")
        return self.mean[:, None] + np.sqrt(self.variance)[:, None] * self._standard

    def state(self) -> dict[str, NDArray]:
        """The mean and the variances."""
        return {"mean": self.mean, "variance": self.variance}

    def restore(self, state: Mapping[str, NDArray]) -> None:
        """Takes over a saved mean and variances; see `Belief.restore`."""
        variance = checked_array(state, "variance", self.variance.shape)
        if np.any(variance <= 0):
            raise ValueError("its variances are not all positive")
        self.mean, self.variance = checked_array(state, "mean", self.mean.shape), variance

    def variance_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """The variance at all points of a lattice; see `Belief.variance_on_lattice`."""
        squares = AxisFeatures(*(factor**2 for factor in self._features.on_lattice(query)))
        return contract(squares, self._features.over_hinges(self.variance)).ravel()

    def variance_near(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The variance at points that lie close together; see `Belief.variance_near`."""
        Phi, weights = self._local_features(points_m)
        return Phi**2 @ self.variance[weights]

    def _local_features(self, points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        box = self._features.box_around(points_m, self._settings.tolerance)
        weights = self._features.weights_in(box)
        Phi = outer_features(self._features.along_axes(points_m, box))
        return (Phi, weights) if np.all(weights >= 0) else (Phi[:, weights >= 0], weights[weights >= 0])

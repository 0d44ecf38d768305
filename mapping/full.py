"""The weights' belief with its full covariance: the default form.

With f = m + Phi (w - mu), Phi = T C and C Sigma C^T = R R^T, the reading's own coordinates are z = R^-1 C
(w - mu) and

    mu' = mu + Y z',   Sigma' = Sigma - Y (I - D^-1) Y^T = Sigma - G G^T,   Y = Sigma C^T R^-T.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular

from .belief import Belief, LearningReport
from .carried_variance import CarriedVariance
from .covariance import DenseCovariance
from .kernel import HingeFeatures
from .lattice import Lattice
from .reduction import Reduction, pivoted_cholesky, reduce_by_pivots, reduce_exactly
from .samples import WeightSamples
from .settings import MapSettings
from .storage import checked_array
from .tiled import TiledCovariance
from .variance_field import VarianceField
from .variational import fit_reading

# What may be left out, as multiples of `MapSettings.tolerance`. Each was raised until it began to add to the
# error in probability after 50 readings (docs/map.md shows the table).
_PIVOT_TOLERANCE = 1.0  # share of |phi|^2 of a point's features that does not follow from the pivots
_ROOT_TOLERANCE = 1.0  # variance of the latent at a pivot that does not follow from the others
_ROW_TOLERANCE = 0.03  # fall of a weight's variance
_SHRINKAGE_TOLERANCE = 300.0  # share of a direction's variance that the reading takes away
_FEATURE_CUTOFF = 10.0  # features of a reading
_QUERY_CUTOFF = 0.01  # terms of the variance at a query point


class FullBelief(Belief):
    """Gaussian belief over the weights, mean and dense covariance."""

    def __init__(
        self,
        features: HingeFeatures,
        settings: MapSettings,
        covariance: DenseCovariance | TiledCovariance,
        variance: VarianceField | CarriedVariance,
    ) -> None:
        """Starts at zero mean, with a covariance and its variance at points as the form keeps them."""
        self._features = features
        self._settings = settings
        self.mean = np.zeros(features.n_weights)
        self.covariance = covariance
        self._variance = variance
        self._samples: WeightSamples | None = None

    @classmethod
    def dense(cls, features: HingeFeatures, settings: MapSettings) -> FullBelief:
        """Returns the prior belief of the form `full`."""
        covariance = DenseCovariance(features.n_weights, settings.weight_variance)
        return cls(features, settings, covariance, VarianceField(features, settings.weight_variance))

    @classmethod
    def local(cls, features: HingeFeatures, settings: MapSettings, query: Lattice | None) -> FullBelief:
        """Returns the prior belief of the form `local`."""
        covariance = TiledCovariance(features, settings.weight_variance)
        cutoff = _QUERY_CUTOFF * settings.tolerance
        return cls(
            features, settings, covariance, CarriedVariance(features, covariance, query, cutoff=cutoff)
        )

    def learn(
        self, points_m: NDArray[np.float64], offset: NDArray[np.float64], log_odds: NDArray[np.float64]
    ) -> LearningReport:
        """Takes in a reading; see the module for the formulas."""
        tolerance = self._settings.tolerance
        reduction = self._reduce(points_m)
        near, C = reduction.hinges, reduction.directions
        weights, cross = self.covariance.cross(C, near)
        root, pivots = self._root(cross[:, np.searchsorted(weights, near)] @ C.T)
        prior_mean = offset + reduction.at_points(C @ self.mean[near])
        basis = reduction.at_points(root)
        reading = fit_reading(prior_mean, basis, log_odds, self._settings.n_em_iterations)
        # Y = Sigma C^T R^-T is not formed: R^-1 is small, so it is applied to what follows it.
        inverse_root = solve_triangular(root[pivots], np.eye(len(pivots)), lower=True, check_finite=False)
        cross = cross[pivots]
        if self._samples is not None:
            self._samples.learn(near, inverse_root @ C[pivots], weights, inverse_root @ cross, reading)
        self.mean[weights] += (reading.mean @ inverse_root) @ cross
        G = cross.T @ (inverse_root.T @ self._shrinkage_root(reading.cholesky))
        touched = np.flatnonzero(np.einsum("ij,ij->i", G, G) > _ROW_TOLERANCE * tolerance)
        G, weights = G[touched], weights[touched]
        self.covariance.lower(weights, G)
        self._variance.lower(weights, G)
        return LearningReport(G.shape[1], len(weights), reading.curvature)

    def carry_samples(self, n_samples: int, rng: np.random.Generator) -> None:
        """Draws weights from the belief and keeps them up with every later reading."""
        self._samples = WeightSamples(self.covariance.draw(n_samples, rng), rng)

    @property
    def samples(self) -> NDArray[np.float64]:
        """The carried draws of the weights, shape (M, n_samples)."""
        if self._samples is None:
            raise ValueError("no samples are carried; call carry_samples(n_samples, rng=rng) first")
        return self.mean[:, None] + self._samples.deviations

    def state(self) -> dict[str, NDArray[np.float64]]:
        """Returns the arrays that make up the belief."""
        return {
            "mean": self.mean,
            "variance_coefficients": self._variance.coefficients,
            **self.covariance.state(),
        }

    def restore(self, state: Mapping[str, NDArray[np.float64]]) -> None:
        """Takes over the arrays of another belief of the same settings and hinges."""
        self.mean = checked_array(state, "mean", self.mean.shape)
        self._variance.coefficients = checked_array(
            state, "variance_coefficients", self._variance.coefficients.shape
        )
        self.covariance.restore(state)

    def variance_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """Returns the variance at all points of a lattice."""
        return np.maximum(self._variance.on_lattice(query), 0)

    def variance_near(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the variance at points that lie close together."""
        return np.maximum(self._variance.at(points_m, _QUERY_CUTOFF * self._settings.tolerance), 0)

    def _reduce(self, points_m: NDArray[np.float64]) -> Reduction:
        tolerance = self._settings.tolerance
        box = self._features.box_around(points_m, _FEATURE_CUTOFF * tolerance)
        weights = self._features.weights_in(box)
        factors = self._features.along_axes(points_m, box)
        if tolerance > 0:
            local = reduce_by_pivots(
                factors,
                weights >= 0,
                tolerance=_PIVOT_TOLERANCE * tolerance,
                cutoff=_FEATURE_CUTOFF * tolerance,
            )
        else:
            local = reduce_exactly(factors, weights >= 0)
        return replace(local, hinges=weights[local.hinges])

    def _root(self, matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Returns R with R R^T = matrix, and the rows that make it triangular."""
        tolerance = self._settings.tolerance
        if tolerance > 0:
            return pivoted_cholesky(matrix, _ROOT_TOLERANCE * tolerance)
        return cholesky(matrix, lower=True, check_finite=False), np.arange(len(matrix))

    def _shrinkage_root(self, factor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns Z with Z Z^T = I - D^-1 for D = Q Q^T, without the directions that the reading left as
        they were.
        """
        identity = np.eye(len(factor))
        shrinkage = identity - cho_solve((factor, True), identity, check_finite=False)
        # Rounding puts a shrinkage of zero at about 1e-16, below what may be a variance.
        return pivoted_cholesky(shrinkage, max(_SHRINKAGE_TOLERANCE * self._settings.tolerance, 1e-15))[0]

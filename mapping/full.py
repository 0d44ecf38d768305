"""The weights' belief with its full covariance: the default form.

With f = m + Phi (w - mu), Phi = T C and C Sigma C^T = R R^T, the reading's own coordinates are z = R^-1 C
(w - mu) and

    mu' = mu + Y z',   Sigma' = Sigma - Y (I - D^-1) Y^T = Sigma - G G^T,   Y = Sigma C^T R^-T.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular

from .belief import Belief, Moments, UpdateReport
from .kernel import HingeFeatures, outer_features
from .lattice import Lattice
from .lattice_moments import LatticeMoments
from .reduction import Reduction, pivoted_cholesky, reduce_by_pivots, reduce_exactly
from .settings import MapSettings
from .variational import fit_reading


class FullBelief(Belief):
    """Gaussian belief over the weights, mean and dense covariance."""

    def __init__(
        self, features: HingeFeatures, settings: MapSettings, query: Lattice | None, prior: Moments
    ) -> None:
        """Starts at zero mean and independent weights; `prior` holds the moments on the query lattice."""
        self._features = features
        self._settings = settings
        self.mean = np.zeros(features.n_weights)
        self.covariance = np.zeros((features.n_weights, features.n_weights))
        np.fill_diagonal(self.covariance, settings.weight_variance)
        self._lattice = None if query is None else LatticeMoments(features, query, prior.variance)

    def learn(
        self, points_m: NDArray[np.float64], offset: NDArray[np.float64], is_occupied: NDArray[np.float64]
    ) -> UpdateReport:
        """Takes in a reading; see the module for the formulas."""
        tolerance = self._settings.tolerance
        reduction = self._reduce(points_m)
        near, directions = reduction.hinges, reduction.directions
        cross = directions @ self.covariance[near]
        root, pivots = _root(cross[:, near] @ directions.T, tolerance)
        prior_mean = offset + reduction.interpolation @ (directions @ self.mean[near])
        basis = reduction.interpolation @ root
        reading = fit_reading(prior_mean, basis, is_occupied, self._settings.n_em_iterations)
        # Y^T = R^-1 C Sigma
        spread = solve_triangular(root[pivots], cross[pivots], lower=True, check_finite=False)
        self.mean += spread.T @ reading.mean
        shrinkage = np.eye(len(pivots)) - cho_solve((reading.cholesky, True), np.eye(len(pivots)))
        fall = spread.T @ pivoted_cholesky(shrinkage, tolerance)[0]
        touched = np.flatnonzero(np.einsum("ij,ij->i", fall, fall) > tolerance)
        fall = fall[touched]
        self.covariance[np.ix_(touched, touched)] -= fall @ fall.T
        if self._lattice is not None:
            self._lattice.lower_variance(touched, fall, cutoff=tolerance)
        return UpdateReport(
            n_points=len(points_m),
            n_occupied=int(is_occupied.sum()),
            rank=fall.shape[1],
            n_weights_touched=len(touched),
        )

    def moments(self, points_m: NDArray[np.float64]) -> Moments:
        """Returns the moments at any points, tile by tile so that only the hinges within reach take part."""
        mean, variance = np.zeros(len(points_m)), np.zeros(len(points_m))
        for part in _tiles(points_m, 4 * self._settings.hinge_spacing_m):
            box = self._features.box_around(points_m[part], self._settings.tolerance)
            weights = self._features.weights_in(box)
            Phi = outer_features(self._features.along_axes(points_m[part], box))[:, weights >= 0]
            weights = weights[weights >= 0]
            mean[part] = Phi @ self.mean[weights]
            variance[part] = np.einsum("nj,nj->n", Phi @ self.covariance[np.ix_(weights, weights)], Phi)
        return Moments(mean, np.maximum(variance, 0))

    def lattice_moments(self) -> Moments:
        """Returns the moments on the query lattice: the mean afresh, the variance as it was carried along."""
        if self._lattice is None:
            raise ValueError("this map has no query lattice; pass query=Lattice(...) when it is made")
        return Moments(self._lattice.mean(self.mean), np.maximum(self._lattice.variance.ravel(), 0))

    def _reduce(self, points_m: NDArray[np.float64]) -> Reduction:
        tolerance = self._settings.tolerance
        # A tenth more than the variances' tolerance is what a feature may miss.
        box = self._features.box_around(points_m, 10 * tolerance)
        weights = self._features.weights_in(box)
        factors = self._features.along_axes(points_m, box)
        if tolerance > 0:
            local = reduce_by_pivots(factors, weights >= 0, tolerance=10 * tolerance, cutoff=10 * tolerance)
        else:
            local = reduce_exactly(factors, weights >= 0)
        return Reduction(local.interpolation, local.directions, weights[local.hinges])


def _root(matrix: NDArray[np.float64], tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Returns R with R R^T = matrix, and the rows that make it triangular."""
    if tolerance > 0:
        return pivoted_cholesky(matrix, tolerance)
    return cholesky(matrix, lower=True, check_finite=False), np.arange(len(matrix))


def _tiles(points_m: NDArray[np.float64], width_m: float) -> list[NDArray[np.intp]]:
    """Returns the indices of the points that share a cube of a given width, cube by cube."""
    cubes = np.floor((points_m - points_m.min(axis=0)) / width_m).astype(np.intp)
    _, cube_of_point = np.unique(cubes, axis=0, return_inverse=True)
    order = np.argsort(cube_of_point, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(cube_of_point[order])) + 1)

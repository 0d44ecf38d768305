"""What one reading says: the variational posterior of a latent in the reading's own coordinates.

The latent at the reading's n points is f = m + B z with z ~ N(0, I) before the reading. Each round sets
lambda(xi) from xi^2 = E[f^2] and solves for the posterior of z. Only xi moves from round to round: the
prior stays what it was before the reading, or one reading would count several times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular

from .likelihood import bound_curvature


@dataclass(frozen=True, eq=False)
class ReadingPosterior:
    """Posterior of z: precision D = I + 2 B^T diag(lambda) B = Q Q^T and mean."""

    mean: NDArray[np.float64]
    """Posterior mean of z, shape (r,)."""
    cholesky: NDArray[np.float64]
    """Q, lower triangular, shape (r, r)."""
    curvature: NDArray[np.float64]
    """lambda at each point in the last round, shape (n,)."""


def fit_reading(
    prior_mean: NDArray[np.float64],
    basis: NDArray[np.float64],
    is_occupied: NDArray[np.float64],
    n_iterations: int,
) -> ReadingPosterior:
    """Returns the posterior of z given the labels of a reading.

    Args:
        prior_mean: Latent mean m at each point before the reading, shape (n,).
        basis: B, shape (n, r).
        is_occupied: Labels y in {0, 1}, shape (n,).
        n_iterations: Rounds of lambda, then posterior.
    """
    xi_squared = np.einsum("nr,nr->n", basis, basis) + prior_mean**2
    posterior = _solve(xi_squared, prior_mean, basis, is_occupied)
    identity = np.eye(basis.shape[1])
    for _ in range(n_iterations - 1):
        inverse = solve_triangular(posterior.cholesky, identity, lower=True, check_finite=False)
        spread = basis @ inverse.T
        # xi^2 = phi Sigma' phi + (b + phi . mu')^2
        xi_squared = np.einsum("nr,nr->n", spread, spread) + (prior_mean + basis @ posterior.mean) ** 2
        posterior = _solve(xi_squared, prior_mean, basis, is_occupied)
    return posterior


def _solve(
    xi_squared: NDArray[np.float64],
    prior_mean: NDArray[np.float64],
    basis: NDArray[np.float64],
    is_occupied: NDArray[np.float64],
) -> ReadingPosterior:
    """Returns the posterior under the bound at given xi, from the prior N(0, I) of z."""
    curvature = bound_curvature(np.sqrt(xi_squared))
    scaled = np.sqrt(2 * curvature)[:, None] * basis
    precision = scaled.T @ scaled
    precision[np.diag_indices_from(precision)] += 1
    factor = cholesky(precision, lower=True, check_finite=False)
    mean = cho_solve((factor, True), basis.T @ (is_occupied - 0.5 - 2 * curvature * prior_mean))
    return ReadingPosterior(mean, factor, curvature)

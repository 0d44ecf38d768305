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

from .likelihood import agreed_mean, bound_curvature, expected_label


@dataclass(frozen=True, eq=False)
class ReadingPosterior:
    """Posterior of z: precision D = I + 2 B^T diag(lambda) B = Q Q^T and mean."""

    mean: NDArray[np.float64]
    """Posterior mean of z, shape (r,)."""
    cholesky: NDArray[np.float64]
    """Q, lower triangular, shape (r, r)."""
    scaled_basis: NDArray[np.float64]
    """sqrt(2 lambda_n) B_n, so that D = I + scaled^T scaled, shape (n, r)."""
    curvature: NDArray[np.float64]
    """lambda at each point, shape (n,)."""

    def move(self, prior_draws: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Returns what turns draws of z from N(0, I), shape (r, S), into draws about the posterior mean.

        D^-1 (z + e) with e ~ N(0, D - I) has covariance D^-1 (I + D - I) D^-1 = D^-1.
        """
        noise = self.scaled_basis.T @ rng.standard_normal((len(self.scaled_basis), prior_draws.shape[1]))
        return cho_solve((self.cholesky, True), prior_draws + noise, check_finite=False) - prior_draws


def fit_reading(
    prior_mean: NDArray[np.float64],
    basis: NDArray[np.float64],
    log_odds: NDArray[np.float64],
    n_iterations: int,
) -> ReadingPosterior:
    """Returns the posterior of z given the labels of a reading.

    Args:
        prior_mean: Latent mean m at each point before the reading, shape (n,).
        basis: B, shape (n, r).
        log_odds: What each label says of its point, log P(label | tumour) / P(label | free), shape (n,).
        n_iterations: Rounds of lambda, then posterior.
    """
    # The first round lets a label speak for itself: a low prior alone would call every hit an error.
    labels = expected_label(0.0, log_odds)
    xi_squared = np.einsum("nr,nr->n", basis, basis) + agreed_mean(prior_mean, labels) ** 2
    posterior = _solve(xi_squared, prior_mean, basis, labels)
    identity = np.eye(basis.shape[1])
    for _ in range(n_iterations - 1):
        inverse = solve_triangular(posterior.cholesky, identity, lower=True, check_finite=False)
        spread = basis @ inverse.T
        mean = prior_mean + basis @ posterior.mean
        # xi^2 = phi Sigma' phi + (b + phi . mu')^2
        xi_squared = np.einsum("nr,nr->n", spread, spread) + mean**2
        posterior = _solve(xi_squared, prior_mean, basis, expected_label(mean, log_odds))
    return posterior


def _solve(
    xi_squared: NDArray[np.float64],
    prior_mean: NDArray[np.float64],
    basis: NDArray[np.float64],
    labels: NDArray[np.float64],
) -> ReadingPosterior:
    """Returns the posterior under the bound at given xi, from the prior N(0, I) of z."""
    curvature = bound_curvature(np.sqrt(xi_squared))
    scaled = np.sqrt(2 * curvature)[:, None] * basis
    precision = scaled.T @ scaled
    precision[np.diag_indices_from(precision)] += 1
    factor = cholesky(precision, lower=True, check_finite=False)
    mean = cho_solve((factor, True), basis.T @ (labels - 0.5 - 2 * curvature * prior_mean))
    return ReadingPosterior(mean, factor, scaled, curvature)

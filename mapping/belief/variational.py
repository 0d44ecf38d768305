"""What one reading says: the belief's update by EM, the paper's learn_parameters (section IV-B).

    P(w | x, y) = P(y | x, w) P(w) / P(y)

is no Gaussian. The paper takes a Gaussian in its place, by the EM of Senanayake and Ramos (2017). With the bound of
`likelihood`, P = Sigma^-1 and mu before the reading, and Phi, b and y of its points, a round is

    P'     = P + 2 Phi^T diag(lambda(xi)) Phi                                 (E step: the posterior N(mu', P'^-1))
    P' mu' = P mu + Phi^T (y - 1/2 - 2 lambda(xi) b)
    xi_n^2 = phi_n P'^-1 phi_n^T + (b_n + phi_n . mu')^2                      (M step: the best xi)

Only xi moves from round to round: P and mu stay what they were before the reading, or one reading would count several
times.

The code does the same in the reading's own coordinates (`coordinates`), in which the latent at its n points is
f = m + B z with z ~ N(0, I) before the reading:

    D      = I + 2 B^T diag(lambda(xi)) B                                     (the posterior N(z', D^-1))
    D z'   = B^T (y - 1/2 - 2 lambda(xi) m)
    xi_n^2 = b_n D^-1 b_n^T + (m_n + b_n . z')^2                              (b_n is row n of B here)

Four things are ours and not the paper's: the offset b (zero under its prior), expected labels in place of y where the
sensor errs (`expected_label`), powers w_n of the likelihood where the points of a reading err together, by which lambda
and y - 1/2 - 2 lambda m are multiplied (`Evidence`), and where the rounds begin (`fit_reading`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, get_blas_funcs, get_lapack_funcs

from ..likelihood import Evidence, agreed_mean, bound_curvature, expected_label, moderation

_SHARE_OF_PRIOR = 0.5
"""Share of the prior's log odds that the first labels heed where labels err together."""


@dataclass(frozen=True, eq=False)
class ReadingPosterior:
    """Posterior of z: precision D = I + 2 B^T diag(lambda) B = Q Q^T and mean."""

    mean: NDArray[np.float64]
    """Posterior mean of z, shape (r,)."""
    cholesky: NDArray[np.float64]
    """Q, lower triangular, shape (r, r)."""
    scaled_basis: NDArray[np.float64]
    """sqrt(2 w_n lambda_n) b_n, so that D = I + scaled^T scaled, shape (n, r)."""
    curvature: NDArray[np.float64]
    """lambda at each point, shape (n,)."""
    labels: NDArray[np.float64]
    """Expected true label of each point, shape (n,)."""

    def move(self, prior_draws: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """What is added to draws of z from N(0, I) to make them draws about the posterior mean, shape (r, S).

        D^-1 (z + e) with e ~ N(0, D - I) has covariance D^-1 (I + D - I) D^-1 = D^-1.

        Args:
            prior_draws: The draws of z, shape (r, S).
            rng: Source of e.
        """
        noise = self.scaled_basis.T @ rng.standard_normal((len(self.scaled_basis), prior_draws.shape[1]))
        return cho_solve((self.cholesky, True), prior_draws + noise, check_finite=False) - prior_draws


@dataclass(frozen=True, eq=False)
class ReadingChange:
    """What another lambda for an earlier reading does to z: the precision becomes D = V diag(d) V^T.

    Where lambda falls, the belief knows less than before and d lies below 1.
    """

    mean: NDArray[np.float64]
    """Change of the mean of z, shape (r,)."""
    precisions: NDArray[np.float64]
    """d, shape (r,)."""
    axes: NDArray[np.float64]
    """V, shape (r, r)."""
    curvature: NDArray[np.float64]
    """The new lambda at each point, shape (n,)."""
    labels: NDArray[np.float64]
    """The new expected true labels, shape (n,)."""

    def root(self, sign: float, tolerance: float) -> NDArray[np.float64]:
        """Z with Z Z^T the part of sign (I - D^-1) that lies above a tolerance, shape (r, s)."""
        share = sign * (1 - 1 / self.precisions)
        chosen = share > tolerance
        return self.axes[:, chosen] * np.sqrt(share[chosen])

    def move(self, prior_draws: NDArray[np.float64]) -> NDArray[np.float64]:
        """What is added to draws of z from N(0, I), shape (r, S), to give them the covariance D^-1: z' = D^-1/2 z."""
        scaled = self.axes * (1 / np.sqrt(self.precisions) - 1)
        return scaled @ (self.axes.T @ prior_draws)


def refit_reading(
    mean: NDArray[np.float64],
    basis: NDArray[np.float64],
    evidence: Evidence,
    curvature: NDArray[np.float64],
    labels: NDArray[np.float64],
    n_iterations: int,
) -> ReadingChange:
    """The change of z by more rounds for a reading that the belief already holds, with xi from what is known now.

    With lambda' and y' in place of the lambda and y that the belief holds, and m and B of now,

        D    = I + 2 B^T diag(lambda' - lambda) B
        D z' = B^T (y' - y - 2 (lambda' - lambda) m)

    Args:
        mean: Latent mean m at each point now, shape (n,).
        basis: B now, shape (n, r).
        evidence: What the n labels say of their points.
        curvature: lambda with which the belief holds the reading, shape (n,).
        labels: The expected labels y with which it does, shape (n,).
        n_iterations: Number of rounds, at least 1.
    """
    xi_squared = np.einsum("nr,nr->n", basis, basis) + mean**2
    change = _refit(xi_squared, mean, mean, basis, evidence, curvature, labels)
    for _ in range(n_iterations - 1):
        latent_mean = mean + basis @ change.mean
        xi_squared = (basis @ change.axes) ** 2 @ (1 / change.precisions) + latent_mean**2
        change = _refit(xi_squared, latent_mean, mean, basis, evidence, curvature, labels)
    return change


def _refit(
    xi_squared: NDArray[np.float64],
    latent_mean: NDArray[np.float64],
    mean: NDArray[np.float64],
    basis: NDArray[np.float64],
    evidence: Evidence,
    curvature: NDArray[np.float64],
    labels: NDArray[np.float64],
) -> ReadingChange:
    """The change of one round, from the lambda and labels that are held to those of a given xi and mean."""
    new_curvature = bound_curvature(np.sqrt(xi_squared))
    new_labels = expected_label(latent_mean, evidence.log_odds)
    change = 2 * evidence.weight * (new_curvature - curvature)
    precisions, axes = np.linalg.eigh(np.eye(basis.shape[1]) + basis.T @ (change[:, None] * basis))
    # What stays is the precision of the prior and the other readings, so d > 0, up to what compression blurs.
    precisions = np.maximum(precisions, 1e-3)
    gradient = basis.T @ (evidence.weight * (new_labels - labels) - change * mean)
    shift = axes @ (axes.T @ gradient / precisions)
    return ReadingChange(shift, precisions, axes, new_curvature, new_labels)


def fit_reading(
    prior_mean: NDArray[np.float64],
    basis: NDArray[np.float64],
    evidence: Evidence,
    n_iterations: int,
    *,
    search_precision: type[np.floating] = np.float64,
) -> ReadingPosterior:
    """The posterior of z given the labels of a reading: `n_iterations` rounds of the module's three lines.

    The rounds begin with the xi of the prior belief, xi_n^2 = b_n b_n^T + m_n^2, but without m_n where the label
    contradicts it, and with labels that speak for themselves.

    Args:
        prior_mean: Latent mean m at each point before the reading, shape (n,).
        basis: B, shape (n, r).
        evidence: What the n labels say of their points.
        n_iterations: Number of rounds, at least 1.
        search_precision: The precision of the rounds before the last, from which nothing but xi is kept; the last is
            always in double.
    """
    variance = np.einsum("nr,nr->n", basis, basis)
    labels = first_labels(prior_mean, variance, evidence)
    xi_squared = variance + agreed_mean(prior_mean, labels) ** 2
    short = basis.astype(search_precision, copy=False)
    posterior = posterior_given_xi(
        xi_squared, prior_mean, basis if n_iterations == 1 else short, labels, evidence.weight
    )
    (invert_triangle,) = get_lapack_funcs(("trtri",), (short,))
    (multiply_triangle,) = get_blas_funcs(("trmm",), (short,))
    for rounds_left in range(n_iterations - 1, 0, -1):
        inverse = posterior.cholesky
        # LAPACK prints a complaint about an empty matrix.
        if basis.shape[1]:
            inverse, _ = invert_triangle(inverse, lower=True)
        spread = multiply_triangle(1.0, inverse, short.T, lower=True)
        mean = prior_mean + short @ posterior.mean
        # xi_n^2 = b_n D^-1 b_n^T + (m_n + b_n . z')^2
        xi_squared = np.einsum("rn,rn->n", spread, spread) + mean**2
        now = basis if rounds_left == 1 else short
        labels = expected_label(mean, evidence.log_odds)
        posterior = posterior_given_xi(xi_squared, prior_mean, now, labels, evidence.weight)
    return posterior


def first_labels(
    prior_mean: NDArray[np.float64], variance: NDArray[np.float64], evidence: Evidence
) -> NDArray[np.float64]:
    """The expected labels with which the rounds begin, shape (n,).

    The rounds end next to where they begin. Labels that err by themselves speak for themselves: with nothing but a low
    prior to go by, every hit would be called an error, also those among others. Where labels err together, each says
    what its neighbours prove besides, and half of the prior weighs it: all of it, or none, gives worse maps.

    Args:
        prior_mean: Latent mean m at each point before the reading, shape (n,).
        variance: The latent's variance there, shape (n,).
        evidence: What the n labels say of their points.
    """
    if np.all(evidence.weight == 1.0):
        return expected_label(0.0, evidence.log_odds)
    return expected_label(_SHARE_OF_PRIOR * moderation(variance) * prior_mean, evidence.log_odds)


def posterior_given_xi(
    xi_squared: NDArray[np.float64],
    prior_mean: NDArray[np.float64],
    basis: NDArray[np.floating],
    labels: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> ReadingPosterior:
    """The posterior N(z', D^-1) under the bound at a given xi, from the prior N(0, I) of z.

    D = I + 2 B^T diag(w lambda(xi)) B,   D z' = B^T diag(w) (y - 1/2 - 2 lambda(xi) m)

    Args:
        xi_squared: xi_n^2 of each point, shape (n,).
        prior_mean: Latent mean m at each point before the reading, shape (n,).
        basis: B, shape (n, r).
        labels: y, or its expectation, shape (n,).
        weight: w, how many labels each counts for, shape (n,).
    """
    curvature = bound_curvature(np.sqrt(xi_squared))
    scaled = np.sqrt(2 * weight * curvature).astype(basis.dtype)[:, None] * basis
    precision = scaled.T @ scaled
    precision[np.diag_indices_from(precision)] += 1
    factor = cholesky(precision, lower=True, check_finite=False)
    gradient = weight * (labels - 0.5 - 2 * curvature * prior_mean)
    mean = cho_solve((factor, True), basis.T @ gradient.astype(basis.dtype))
    return ReadingPosterior(mean, factor, scaled, curvature, labels)

"""The logistic likelihood of a label, its Gaussian lower bound, and the probability that a Gaussian latent
gives.

The bound of Jaakkola and Jordan (2000), which Senanayake and Ramos (2017) use for Hilbert maps, is for f
the latent

    log sigma((2y - 1) f) >= (y - 1/2) f - lambda(xi) (f^2 - xi^2) - xi / 2 + log sigma(xi),
    lambda(xi) = (sigma(xi) - 1/2) / (2 xi) = tanh(xi / 2) / (4 xi),

tight at xi^2 = E[f^2], so that each label acts as a Gaussian observation of f with precision 2 lambda(xi).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit


def bound_curvature(xi: ArrayLike) -> NDArray[np.float64]:
    """Returns lambda(xi) of the bound, 1/8 at xi = 0."""
    xi = np.abs(np.asarray(xi, dtype=np.float64))
    # Below 1e-4 the series 1/8 - xi^2 / 96 is exact to rounding and has no 0/0.
    is_small = xi < 1e-4
    safe = np.where(is_small, 1.0, xi)
    return np.where(is_small, 0.125 - xi**2 / 96, np.tanh(safe / 2) / (4 * safe))


def moderation(latent_variance: ArrayLike) -> NDArray[np.float64]:
    """Returns kappa(v) = 1 / sqrt(1 + pi v / 8), which pulls a probability to 1/2 as the latent's variance
    v grows.
    """
    return 1 / np.sqrt(1 + np.pi / 8 * np.asarray(latent_variance, dtype=np.float64))


def occupancy_probability(latent_mean: ArrayLike, latent_variance: ArrayLike) -> NDArray[np.float64]:
    """Returns E[sigma(f)] for a Gaussian latent f, by MacKay's approximation sigma(kappa(v) m)."""
    return expit(moderation(latent_variance) * np.asarray(latent_mean, dtype=np.float64))


def prior_offset(prevalence: float, latent_variance: ArrayLike) -> NDArray[np.float64]:
    """Returns the latent's prior mean b with which a point of the given prior variance expects the given
    prevalence.

    It solves sigma(kappa(v) b) = prevalence; a prevalence of 1/2 gives 0, the paper's prior.
    """
    return np.log(prevalence / (1 - prevalence)) / moderation(latent_variance)

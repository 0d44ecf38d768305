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


def agreed_mean(latent_mean: NDArray[np.float64], labels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the latent's mean where the label lies on its side of zero, else 0: the start of xi.

    The rounds shrink a xi slowly, and one from a mean that the label contradicts lies far above where they
    end.
    """
    return np.where((latent_mean > 0) == (labels > 0.5), latent_mean, 0.0)


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


def label_log_odds(
    is_occupied: NDArray[np.float64], false_positive_rate: float, false_negative_rate: float
) -> NDArray[np.float64]:
    """Returns log P(label | tumour) / P(label | free) for each label, infinite where a label cannot be wrong.

    Args:
        is_occupied: Labels as the sensor gave them, shape (n,).
        false_positive_rate: Share of free points that the sensor calls occupied.
        false_negative_rate: Share of tumour points that the sensor calls free.
    """
    with np.errstate(divide="ignore"):
        if_occupied = np.log1p(-false_negative_rate) - np.log(false_positive_rate)
        if_free = np.log(false_negative_rate) - np.log1p(-false_positive_rate)
    return np.where(is_occupied > 0.5, if_occupied, if_free)


def expected_label(latent_mean: ArrayLike, log_odds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the probability that a point is truly occupied given its label and the latent's mean.

    With the true label z unknown, the bound is linear in z, so its expectation takes the place of the
    label; the best
    q(z) under the bound has the log odds E[f] + log P(label | z = 1) / P(label | z = 0).
    """
    return expit(np.asarray(latent_mean, dtype=np.float64) + log_odds)

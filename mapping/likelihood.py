"""The logistic likelihood of a label, its Gaussian lower bound, and the probability that a Gaussian latent gives.

The likelihood is the paper's (section IV-B), with an offset b(x) in the latent that is zero under its prior:

    P(y = 1 | x, w) = sigma(f(x)),   f(x) = b(x) + phi(x) . w

The posterior of w is no Gaussian. The paper refers to Senanayake and Ramos (2017) for a Gaussian in its place, and they
use the bound of Jaakkola and Jordan (2000), for labels y of 0 or 1:

    log P(y | f) >= (y - 1/2) f - lambda(xi) (f^2 - xi^2) - xi / 2 + log sigma(xi),
    lambda(xi) = (sigma(xi) - 1/2) / (2 xi) = tanh(xi / 2) / (4 xi).

The best xi is xi^2 = E[f^2]. The bound is quadratic in f, so each label acts as a Gaussian observation of f with
precision 2 lambda(xi). `belief/variational.py` learns a reading by it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit


def bound_curvature(xi: ArrayLike) -> NDArray[np.float64]:
    """The bound's lambda(xi) = tanh(xi / 2) / (4 xi), 1/8 at xi = 0, in the shape of xi."""
    xi = np.abs(np.asarray(xi, dtype=np.float64))
    # Below 1e-4 the series 1/8 - xi^2 / 96 is exact to rounding and has no 0/0.
    is_small = xi < 1e-4
    safe = np.where(is_small, 1.0, xi)
    return np.where(is_small, 0.125 - xi**2 / 96, np.tanh(safe / 2) / (4 * safe))


def agreed_mean(latent_mean: NDArray[np.float64], labels: NDArray[np.float64]) -> NDArray[np.float64]:
    """The latent's mean where the label is on the same side of zero, and 0 elsewhere, shape (n,): for the first xi.

    The rounds shrink a xi slowly, and one that starts from a mean which the label contradicts lies far above where
    they end.

    Args:
        latent_mean: Mean of the latent at each point, shape (n,).
        labels: Their labels, 0 or 1 or between, shape (n,).
    """
    return np.where((latent_mean > 0) == (labels > 0.5), latent_mean, 0.0)


def moderation(latent_variance: ArrayLike) -> NDArray[np.float64]:
    """MacKay's kappa(v) = 1 / sqrt(1 + pi v / 8): it pulls a probability to 1/2 as the latent's variance v grows."""
    return 1 / np.sqrt(1 + np.pi / 8 * np.asarray(latent_variance, dtype=np.float64))


def occupancy_probability(latent_mean: ArrayLike, latent_variance: ArrayLike) -> NDArray[np.float64]:
    """The probability of occupancy E[sigma(f)] of a Gaussian latent f, by MacKay's approximation sigma(kappa(v) m).

    The paper writes P(y | x*, w) for it; here w is averaged over its belief.

    Args:
        latent_mean: Mean m of the latent at each point, shape (N,).
        latent_variance: Its variance v, shape (N,).
    """
    return expit(moderation(latent_variance) * np.asarray(latent_mean, dtype=np.float64))


def prior_offset(prevalence: float, latent_variance: ArrayLike) -> NDArray[np.float64]:
    """The offset b with which the map without readings expects a prevalence, in the shape of the variance.

    It solves sigma(kappa(v) b) = prevalence; a prevalence of 1/2 gives 0, the paper's prior.

    Args:
        prevalence: Share of the organ that is expected to be tumour, between 0 and 1.
        latent_variance: The latent's prior variance v at each point.
    """
    return np.log(prevalence / (1 - prevalence)) / moderation(latent_variance)


def label_log_odds(
    is_occupied: NDArray[np.float64], false_positive_rate: float, false_negative_rate: float
) -> NDArray[np.float64]:
    """What each label says: log P(label | tumour) / P(label | free), shape (n,), infinite where it cannot be wrong.

    Args:
        is_occupied: Labels as the sensor gave them, shape (n,).
        false_positive_rate: Share of free points that the sensor calls tumour.
        false_negative_rate: Share of tumour points that the sensor calls free.
    """
    with np.errstate(divide="ignore"):
        if_occupied = np.log1p(-false_negative_rate) - np.log(false_positive_rate)
        if_free = np.log(false_negative_rate) - np.log1p(-false_positive_rate)
    return np.where(is_occupied > 0.5, if_occupied, if_free)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the labels of a reading say, and how many labels each of them counts for."""

    log_odds: NDArray[np.float64]
    """log P(label | tumour) / P(label | free) of each label, shape (n,), infinite where it cannot be wrong."""
    weight: NDArray[np.float64]
    """The power w of each label's likelihood, shape (n,): 1 where it errs by itself, less where it errs with others."""


def evidence_of(
    labels: NDArray[np.float64],
    rates: tuple[float, float],
    log_odds: ArrayLike | None,
    weight: ArrayLike | None,
) -> Evidence:
    """What labels say, by what is told of each or else by the sensor's rates.

    Args:
        labels: Labels as the sensor gave them, 0 or 1, shape (n,).
        rates: The rates of false positives and of false negatives, for labels of which nobody tells more.
        log_odds: log P(label | tumour) / P(label | free) of each, shape (n,); None where the rates say it.
        weight: How many labels each counts for, shape (n,); None where each counts in full.

    Raises:
        ValueError: If what is told does not fit the labels, log odds are no number, or a weight is out of its range.
    """
    said = label_log_odds(labels, *rates) if log_odds is None else _per_label("log_odds", log_odds, labels)
    counted = np.ones(len(labels)) if weight is None else _per_label("weight", weight, labels)
    if np.isnan(said).any():
        raise ValueError("log_odds holds NaN: give each label a number, or an infinity where it is certain")
    if not np.all((counted > 0) & (counted <= 1)):
        raise ValueError("weight must lie above 0 and be at most 1 for each label")
    return Evidence(said, counted)


def _per_label(name: str, values: ArrayLike, labels: NDArray[np.float64]) -> NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    if array.shape != labels.shape:
        raise ValueError(
            f"{name} must hold one value for each of {len(labels)} labels, not shape {array.shape}"
        )
    return array


def expected_label(latent_mean: ArrayLike, log_odds: NDArray[np.float64]) -> NDArray[np.float64]:
    """The probability that each point truly is tumour, given its label and the latent's mean, shape (n,).

    Where labels may be wrong, the true label z is unknown. The bound is linear in z, so the expectation of z takes
    the label's place. The best q(z) under the bound has log odds E[f] + log P(label | z = 1) / P(label | z = 0).

    Args:
        latent_mean: E[f] at each point, shape (n,), or one value for all.
        log_odds: What each label says, from `label_log_odds`, shape (n,).
    """
    return expit(np.asarray(latent_mean, dtype=np.float64) + log_odds)

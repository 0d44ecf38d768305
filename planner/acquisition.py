"""Acquisition functions: how promising a value is, given its mean and variance.

Expected improvement is eq. 2 of Cho, Hermans and Kuntz (2021), after Jones, Schonlau and Welch (1998). Its logarithm
follows Ament et al., "Unexpected improvements to expected improvement for Bayesian optimization" (2023), eq. 9. The
probability of improvement is Kushner's (1964), the upper confidence bound that of Srinivas et al. (2010), and the
mutual information that of Houlsby et al., "Bayesian active learning for classification and preference learning"
(2011), eq. 2.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import entr, erfcx, expit, log_ndtr, ndtr

from .errors import PlannerError

VARIANCE_FLOOR = 1e-12
"""Least variance that counts: its root, 1e-6, is far below any margin xi in use."""
N_QUADRATURE_NODES = 81
"""Nodes for the moments of the probability, evenly spaced over +-6 deviations: errors stay below 1e-5 up to a latent
deviation of 10. The trapezoidal rule converges geometrically here; Gauss-Hermite with 40 nodes errs by 1e-2."""

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)
_LOG_ROOT_HALF_PI = 0.5 * math.log(0.5 * math.pi)
_ASYMPTOTIC_BELOW = -1e4
"""Standardised improvement z below which 1 - sqrt(pi / 2) |z| erfcx(|z| / sqrt 2) is taken to be 1 / z^2."""


def expected_improvement(
    mean: ArrayLike, variance: ArrayLike, *, incumbent: float, xi: float = 0.01
) -> NDArray[np.float64]:
    """The expected improvement of normal values over the incumbent (eq. 2), in the values' unit, shape (M,).

        EI = (mu - f+ - xi) Phi(z) + sigma phi(z),   z = (mu - f+ - xi) / sigma   (eq. 2)

    is E[max(0, f - f+ - xi)], for f normal with mean mu and deviation sigma, Phi and phi being the normal distribution
    function and density. The paper writes Sigma in the second term for the same standard deviation sigma, and its
    expectation leaves out the xi that its eq. 2 has. As the deviation goes to 0, EI goes to max(0, mu - f+ - xi).

    Args:
        mean: Means mu, shape (M,).
        variance: Variances sigma^2, shape (M,); one below VARIANCE_FLOOR counts as that.
        incumbent: The best value so far, f+, the paper's f(x+).
        xi: Margin by which the incumbent has to be exceeded, the paper's 0.01; a larger one explores more.

    Raises:
        PlannerError: If an input is not finite.
    """
    improvement, deviation = _improvement_and_deviation(mean, variance, incumbent, xi)
    z = improvement / deviation
    density = np.exp(-0.5 * z**2 - _LOG_ROOT_TWO_PI)
    # Rounding may leave -1e-17.
    return np.maximum(improvement * ndtr(z) + deviation * density, 0.0)


def log_expected_improvement(
    mean: ArrayLike, variance: ArrayLike, *, incumbent: float, xi: float = 0.01
) -> NDArray[np.float64]:
    """The natural logarithm of the expected improvement (eq. 2), finite where EI itself underflows to 0, shape (M,).

    It has the same argmax and does not tie: with a confident tumour as the incumbent, all other points lie tens of
    deviations below it.

    Args:
        mean: Means mu, shape (M,).
        variance: Variances sigma^2, shape (M,); one below VARIANCE_FLOOR counts as that.
        incumbent: The best value so far, f+.
        xi: Margin by which the incumbent has to be exceeded.

    Raises:
        PlannerError: If an input is not finite.
    """
    improvement, deviation = _improvement_and_deviation(mean, variance, incumbent, xi)
    return np.log(deviation) + _log_standard_improvement(improvement / deviation)


def log_probability_of_improvement(
    mean: ArrayLike, variance: ArrayLike, *, incumbent: float, xi: float = 0.01
) -> NDArray[np.float64]:
    """The natural logarithm of the probability that normal values exceed the incumbent, log Phi(z), shape (M,).

    The z is that of `expected_improvement`. The logarithm has the same argmax and does not underflow.

    Args:
        mean: Means mu, shape (M,).
        variance: Variances sigma^2, shape (M,); one below VARIANCE_FLOOR counts as that.
        incumbent: The best value so far, f+.
        xi: Margin by which the incumbent has to be exceeded.

    Raises:
        PlannerError: If an input is not finite.
    """
    improvement, deviation = _improvement_and_deviation(mean, variance, incumbent, xi)
    return log_ndtr(improvement / deviation)


def upper_confidence_bound(mean: ArrayLike, variance: ArrayLike, *, beta: float) -> NDArray[np.float64]:
    """The upper confidence bound mu + beta sigma of normal values, in the values' unit, shape (M,).

    Args:
        mean: Means mu, shape (M,).
        variance: Variances sigma^2, shape (M,).
        beta: How many deviations above the mean the bound lies, 0 or above.
    """
    return np.asarray(mean, dtype=np.float64) + beta * np.sqrt(np.maximum(variance, 0.0))


def mutual_information(latent_mean: ArrayLike, latent_variance: ArrayLike) -> NDArray[np.float64]:
    """The information [nat] that a label y of chance sigma(f) gives about a normal latent f, by quadrature, shape (M,).

        I(y; f) = H(E[sigma(f)]) - E[H(sigma(f))],   H(p) = -p log p - (1 - p) log(1 - p)

    Args:
        latent_mean: Latent means, shape (M,).
        latent_variance: Latent variances, shape (M,).
    """
    mean_probability, mean_entropy = _expectations(latent_mean, latent_variance, expit, _entropy_of_logit)
    return np.maximum(_entropy(mean_probability) - mean_entropy, 0.0)


def probability_variance(latent_mean: ArrayLike, latent_variance: ArrayLike) -> NDArray[np.float64]:
    """The variance of the probability sigma(f) of a normal latent f, by quadrature, shape (M,).

    Args:
        latent_mean: Latent means, shape (M,).
        latent_variance: Latent variances, shape (M,).
    """
    first, second = _expectations(latent_mean, latent_variance, expit, lambda latent: expit(latent) ** 2)
    return np.maximum(second - first**2, 0.0)


def _expectations(
    latent_mean: ArrayLike,
    latent_variance: ArrayLike,
    *functions: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> list[NDArray[np.float64]]:
    """The expectation of each function of a normal latent, by the trapezoidal rule, each of shape (M,)."""
    mean = np.asarray(latent_mean, dtype=np.float64)
    deviation = np.sqrt(np.maximum(np.asarray(latent_variance, dtype=np.float64), VARIANCE_FLOOR))
    nodes = np.linspace(-6.0, 6.0, N_QUADRATURE_NODES)
    weights = np.exp(-0.5 * nodes**2)
    weights /= weights.sum()
    totals = [np.zeros_like(mean) for _ in functions]
    for node, weight in zip(nodes, weights, strict=True):
        latent = mean + node * deviation
        for total, function in zip(totals, functions, strict=True):
            total += weight * function(latent)
    return totals


def _entropy(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    return entr(probability) + entr(1.0 - probability)


def _entropy_of_logit(latent: NDArray[np.float64]) -> NDArray[np.float64]:
    return _entropy(expit(latent))


def _improvement_and_deviation(
    mean: ArrayLike, variance: ArrayLike, incumbent: float, xi: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The mean improvement mu - f+ - xi and the deviation; the one place where a variance is floored."""
    mean = np.asarray(mean, dtype=np.float64)
    variance = np.asarray(variance, dtype=np.float64)
    if not (np.isfinite(mean).all() and np.isfinite(variance).all() and math.isfinite(incumbent)):
        raise PlannerError(
            "expected improvement needs finite means, variances and incumbent, but the belief holds NaN or "
            "infinity: check the readings that it learnt from"
        )
    if not 0.0 <= xi < math.inf:
        raise PlannerError(f"`xi` must be 0 or above and finite, got {xi}")
    return mean - incumbent - xi, np.sqrt(np.maximum(variance, VARIANCE_FLOOR))


def _log_standard_improvement(z: NDArray[np.float64]) -> NDArray[np.float64]:
    """The logarithm log(phi(z) + z Phi(z)) without cancellation, for any z.

    Below -1 it is log phi(z) + log(1 - sqrt(pi / 2) |z| erfcx(|z| / sqrt 2)), and the last bracket goes to 1 / z^2.
    """
    log_density = -0.5 * z**2 - _LOG_ROOT_TWO_PI
    near = np.maximum(z, -1.0)
    near_value = np.log(np.exp(-0.5 * near**2 - _LOG_ROOT_TWO_PI) + near * ndtr(near))
    far = np.clip(-z, 1.0, -_ASYMPTOTIC_BELOW)
    tail = -np.expm1(np.log(erfcx(far / math.sqrt(2.0)) * far) + _LOG_ROOT_HALF_PI)
    far_value = log_density + np.log(tail) + 2.0 * np.log(far / np.maximum(-z, far))
    return np.where(z > -1.0, near_value, far_value)

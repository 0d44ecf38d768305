"""Expected improvement against its definition, its limits and its laws."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import expit
from scipy.stats import norm

from planner import PlannerError
from planner.acquisition import expected_improvement, log_expected_improvement, probability_variance


@pytest.mark.parametrize(
    ("mean", "deviation", "incumbent"), [(0.0, 1.0, 0.5), (-1.0, 2.0, 1.0), (3.0, 0.5, 2.0)]
)
def test_closed_form_agrees_with_monte_carlo(mean, deviation, incumbent):
    xi = 0.01
    draws = np.random.default_rng(7).normal(mean, deviation, 400_000)
    improvements = np.maximum(0.0, draws - incumbent - xi)
    # Five standard errors of the Monte Carlo mean: missed by chance once in 2 million.
    tolerance = 5.0 * improvements.std() / np.sqrt(len(draws))
    closed = expected_improvement(mean, deviation**2, incumbent=incumbent, xi=xi)
    assert closed == pytest.approx(improvements.mean(), abs=tolerance)


def test_without_variance_it_is_the_certain_improvement():
    mean = np.array([-2.0, 0.99, 1.0, 1.01, 1.5])
    improvement = expected_improvement(mean, np.zeros(5), incumbent=1.0, xi=0.01)
    # The floored deviation of 1e-6 leaves at most phi(0) 1e-6 = 4e-7.
    np.testing.assert_allclose(improvement, [0.0, 0.0, 0.0, 0.0, 0.49], atol=5e-7)


def test_a_variance_below_zero_by_rounding_counts_as_zero():
    below = expected_improvement(2.0, -1e-9, incumbent=1.0)
    assert below == expected_improvement(2.0, 0.0, incumbent=1.0)


def test_it_grows_with_mean_and_with_variance():
    values = np.linspace(-3.0, 3.0, 61)
    assert (np.diff(expected_improvement(values, np.ones(61), incumbent=0.0)) > 0).all()
    variances = np.linspace(0.1, 9.0, 61)
    assert (np.diff(expected_improvement(np.full(61, -1.0), variances, incumbent=0.0)) > 0).all()


def test_the_logarithm_agrees_with_the_plain_form_where_that_does_not_underflow():
    z = np.linspace(-9.0, 9.0, 2_001)
    plain = expected_improvement(z, np.ones_like(z), incumbent=0.0, xi=0.0)
    # At z = -9 the plain form cancels: z Phi and phi agree to 1 / z^2, which costs 2 of 16 digits;
    # the rest is scipy's own error in the normal tail.
    np.testing.assert_allclose(
        log_expected_improvement(z, np.ones_like(z), incumbent=0.0, xi=0.0),
        np.log(plain),
        rtol=1e-11,
        atol=1e-12,
    )


def test_the_logarithm_follows_the_tail_far_below_the_incumbent():
    z = -np.array([50.0, 1e3, 9.9e3, 1.1e4, 1e6])
    log_ei = log_expected_improvement(z, np.ones(5), incumbent=0.0, xi=0.0)
    # Mills' ratio: phi(z) / z^2 (1 - 3 / z^2 + ...), so the error is at most 3 / 50^2 at the first.
    np.testing.assert_allclose(log_ei, norm.logpdf(z) - 2.0 * np.log(-z), atol=2e-3)
    assert (np.diff(log_ei) < 0).all()


@pytest.mark.parametrize("mean", [np.nan, np.inf])
def test_a_belief_that_is_not_finite_is_refused(mean):
    with pytest.raises(PlannerError, match="NaN or infinity"):
        expected_improvement(np.array([0.0, mean]), np.ones(2), incumbent=0.0)


def test_a_negative_margin_is_refused():
    with pytest.raises(PlannerError, match="`xi` must be 0 or above"):
        expected_improvement(0.0, 1.0, incumbent=0.0, xi=-1.0)


@pytest.mark.parametrize(("mean", "deviation"), [(0.0, 0.5), (-2.0, 2.0), (1.0, 4.0), (-3.0, 10.0)])
def test_variance_of_the_probability_agrees_with_numerical_integration(mean, deviation):
    def moment(power):
        return quad(
            lambda f: expit(f) ** power * norm.pdf(f, mean, deviation),
            mean - 12 * deviation,
            mean + 12 * deviation,
        )[0]

    expected = moment(2) - moment(1) ** 2
    # The rule's stated error up to a deviation of 10.
    assert probability_variance(mean, deviation**2) == pytest.approx(expected, abs=1e-5)


def test_variance_of_the_probability_has_its_two_limits():
    # Certain latent: none. Boundless latent around 0: a coin of probability 0 or 1, variance 1/4.
    assert probability_variance(0.3, 0.0) == pytest.approx(0.0, abs=1e-12)
    # At a deviation of 100 the sigmoid is nearly a step; the node at 0, with 6 % of the weight, sees 1/2
    # in place of 0 or 1, which costs 0.06 / 4.
    assert probability_variance(0.0, 1e4) == pytest.approx(0.25, abs=0.02)

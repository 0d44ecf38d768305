"""Estimates: against independent computations, and intervals that hold a planted truth as often as they claim."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from sim.comparison.estimates import mean_estimate, median_with_interval, paired_estimate, share_interval


def test_a_mean_and_its_deviation_are_those_of_the_definition() -> None:
    estimate = mean_estimate([1.0, 2.0, 6.0])
    assert (estimate.n, estimate.mean, estimate.deviation) == (3, 3.0, math.sqrt((4 + 1 + 9) / 2))


def test_the_interval_of_a_mean_of_normal_values_is_student_s() -> None:
    sample = np.random.default_rng(0).normal(5.0, 2.0, 400)
    estimate = mean_estimate(sample)
    low, high = stats.t.interval(0.95, 399, sample.mean(), stats.sem(sample))
    assert estimate.interval == pytest.approx((low, high), abs=0.02)  # a tenth of the interval's half width


def test_intervals_of_means_hold_the_truth_about_as_often_as_they_say() -> None:
    """A skewed law, as numbers of actions have; 0.95 +- 4 standard errors of 100 draws, less the bootstrap's known
    shortfall of some per cent at this size."""
    rng = np.random.default_rng(1)
    intervals = [mean_estimate(rng.exponential(20.0, 30)).interval for _ in range(100)]
    assert np.mean([low <= 20.0 <= high for low, high in intervals]) >= 0.83


def test_the_same_sample_gives_the_same_interval() -> None:
    sample = np.random.default_rng(2).exponential(size=20)
    assert mean_estimate(sample) == mean_estimate(sample)


def test_one_value_and_equal_values_are_no_problem() -> None:
    assert math.isnan(mean_estimate([3.0]).interval[0])
    assert mean_estimate([3.0, 3.0, 3.0]).interval == (3.0, 3.0)


@pytest.mark.parametrize("bad", [[], [1.0, math.nan], [1.0, math.inf]])
def test_a_mean_of_what_is_not_finite_is_refused(bad) -> None:
    with pytest.raises(ValueError, match="finite"):
        mean_estimate(bad)


def test_a_median_knows_trials_that_never_got_there() -> None:
    assert median_with_interval([1, 2, 3, math.inf, math.inf])[0] == 3
    assert median_with_interval([1, 2, math.inf, math.inf])[0] == math.inf
    assert median_with_interval([math.inf] * 3)[0] == math.inf
    assert median_with_interval([5, 1])[0] == 3


@pytest.mark.parametrize("n", [6, 9, 10, 25, 100])
def test_the_median_s_interval_is_the_narrowest_with_enough_probability(n) -> None:
    """Independently: sum the binomial over the counts below the median that leave it within the interval."""
    _, (low, high) = median_with_interval(np.arange(1, n + 1))
    below, above = int(low), int(high)

    def coverage(first: int, last: int) -> float:
        return sum(math.comb(n, k) for k in range(first, last)) / 2**n

    assert above == n + 1 - below
    assert coverage(below, above) >= 0.95
    assert coverage(below + 1, above - 1) < 0.95


def test_five_trials_have_no_interval_of_the_median() -> None:
    assert math.isnan(median_with_interval([1, 2, 3, 4, 5])[1][0])


def test_pairs_count_wins_and_ties_in_the_direction_of_the_measure() -> None:
    first, second = [1, 5, 3, 2], [2, 4, 3, 9]
    low = paired_estimate(first, second, lower_is_better=True)
    assert (low.n_wins, low.n_ties, low.win_rate) == (2, 1, 2.5 / 4)
    high = paired_estimate(first, second, lower_is_better=False)
    assert (high.n_wins, high.n_ties, high.win_rate) == (1, 1, 1.5 / 4)
    assert low.difference.mean == pytest.approx(np.mean(np.subtract(first, second)))


def test_pairing_finds_a_small_difference_that_hides_in_the_spread_of_seeds() -> None:
    rng = np.random.default_rng(3)
    hardness = rng.exponential(50.0, 60)
    first, second = hardness + rng.normal(0, 1, 60), hardness + 2.0 + rng.normal(0, 1, 60)
    low, high = paired_estimate(first, second, lower_is_better=True).difference.interval
    assert low <= -2.0 <= high < 0
    assert mean_estimate(first).interval[1] > mean_estimate(second).interval[0]  # unpaired, they overlap


def test_a_share_s_interval_holds_every_share_that_a_score_test_would_not_reject() -> None:
    """Wilson's interval by its definition, on a grid, at shares that the formula has never seen."""
    grid = np.linspace(0.0005, 0.9995, 2000)
    for n, wins in itertools.product((5, 40), (0, 1, 3.5, 5)):
        z = (wins / n - grid) / np.sqrt(grid * (1 - grid) / n)
        accepted = grid[np.abs(z) <= stats.norm.ppf(0.975)]
        low, high = share_interval(wins / n, n)
        assert (low, high) == pytest.approx((accepted.min(), accepted.max()), abs=1e-3)

"""How far labels can be believed: rates against rates, many labels for one, and what neighbours prove."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from mapping import ErrorRates, HilbertMap, LabelledPoints, Lattice, MapSettings
from mapping.likelihood import label_log_odds
from mapping.trust.judging import judged, n_together

LATTICE = Lattice.from_box((-0.04, -0.04, -0.04), (0.04, 0.04, 0.04), spacing_m=0.008)


def points(n: int, seed: int = 0, half_m: float = 0.02):
    return np.random.default_rng(seed).uniform(-half_m, half_m, (n, 3))


def test_labels_that_err_alone_say_what_their_rates_say() -> None:
    is_tumour = np.arange(20) % 3 == 0
    own = judged(LabelledPoints(points(20), is_tumour), ErrorRates(false_positive=0.05, false_negative=0.2))
    np.testing.assert_allclose(own.log_odds, label_log_odds(is_tumour.astype(float), 0.05, 0.2))
    assert own.weight is None


def test_a_sensor_without_errors_says_it_for_certain() -> None:
    own = judged(LabelledPoints(points(5), np.array([True, False, True, False, False])), ErrorRates())
    assert np.array_equal(np.isposinf(own.log_odds), own.is_occupied)


def test_log_odds_that_are_told_teach_a_map_what_its_own_rates_would() -> None:
    is_tumour = np.linalg.norm(points(200), axis=1) < 0.012
    rates = MapSettings(false_positive_rate=0.05, false_negative_rate=0.1)
    by_rates, told = HilbertMap(LATTICE, rates, query=LATTICE), HilbertMap(LATTICE, query=LATTICE)
    by_rates.update(points(200), is_tumour)
    told.update(points(200), is_tumour, log_odds=label_log_odds(is_tumour.astype(float), 0.05, 0.1))
    np.testing.assert_array_equal(by_rates.predict_lattice().score, told.predict_lattice().score)


@pytest.mark.parametrize("n", [3, 5, 30])
def test_labels_at_one_place_that_count_for_one_teach_the_same_whatever_their_number(n: int) -> None:
    """The likelihood of n labels to the power 1 / n is that of one label, whatever n is."""
    few, many = (taught_at_one_place(each) for each in (2, n))
    np.testing.assert_allclose(many.score, few.score, rtol=1e-9)
    np.testing.assert_allclose(many.latent_variance, few.latent_variance, rtol=1e-9)


def taught_at_one_place(n: int):
    belief = HilbertMap(LATTICE, MapSettings(tolerance=0.0), query=LATTICE)
    places_m = np.tile([0.001, 0.002, -0.003], (n, 1))
    belief.update(places_m, np.ones(n, bool), log_odds=np.full(n, 3.0), weight=np.full(n, 1 / n))
    return belief.predict_lattice()


def test_labels_that_say_little_leave_a_low_prior_low() -> None:
    """At log odds of 1, and a prior of 2 per cent, a label that errs with others makes no tumour."""
    belief = HilbertMap(LATTICE, MapSettings(), query=LATTICE)
    belief.update(points(50), np.ones(50, bool), log_odds=np.full(50, 1.0), weight=np.full(50, 1 / 50))
    assert belief.predict(points(50)).probability.max() < 0.3


def test_weights_stay_with_readings_that_are_fitted_again() -> None:
    """A sweep over one reading ends where more rounds would: with or without the weights, not in between."""
    is_tumour = np.linalg.norm(points(100), axis=1) < 0.012
    many = HilbertMap(LATTICE, MapSettings(n_em_iterations=30, tolerance=0.0), query=LATTICE)
    swept = HilbertMap(LATTICE, MapSettings(n_em_iterations=4, tolerance=0.0), query=LATTICE)
    for each in (many, swept):
        each.update(points(100), is_tumour, weight=np.full(100, 0.2))
    swept.revise(10)
    np.testing.assert_allclose(swept.predict_lattice().score, many.predict_lattice().score, atol=0.02)


def test_lone_labels_are_slips_and_labels_in_company_are_not() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(6.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) * 0.006
    is_tumour = np.zeros(len(grid), bool)
    is_tumour[0] = True
    is_tumour[np.linalg.norm(grid - grid[-1], axis=1) < 0.011] = True
    rates = ErrorRates(false_positive=0.05, false_negative=0.05, missed=0.08, invented=0.002)
    own = judged(LabelledPoints(grid, is_tumour), rates)
    agreeing = LabelledPoints(grid, is_tumour).n_agreeing
    assert agreeing[0] == 1
    assert agreeing[-1] >= 4
    slip = binom.sf(0, 8, 0.05)
    expected = np.log(0.92 * (1 - slip) / (0.002 + 0.998 * slip))
    assert own.log_odds[0] == pytest.approx(expected)
    assert own.log_odds[-1] > 5.0 > own.log_odds[0]
    assert len(own.believed_tumour_m(0.0))
    assert 0.0 not in np.linalg.norm(own.believed_tumour_m(0.0), axis=1)


def test_no_label_speaks_against_itself() -> None:
    """However bad the sensor, a label of tumour never makes a place less likely tumour."""
    rates = ErrorRates(false_positive=0.45, false_negative=0.45, missed=0.5, invented=0.45)
    is_tumour = np.random.default_rng(1).random(100) < 0.5
    own = judged(LabelledPoints(points(100), is_tumour), rates)
    assert np.all(np.where(is_tumour, own.log_odds, -own.log_odds) >= 0.0)


def test_a_view_says_no_more_of_a_place_than_its_chance_to_be_wrong() -> None:
    """The free labels within `together_m` of a place say log(missed) together, whatever their number."""
    for n in (30, 300):
        points_m = points(n, half_m=0.002)
        own = judged(LabelledPoints(points_m, np.zeros(n, bool)), ErrorRates(missed=0.1, invented=0.001))
        assert float(own.weight @ own.log_odds) == pytest.approx(np.log(0.1 / 0.999), rel=1e-3)


def test_numbers_together_are_those_of_a_brute_force_count() -> None:
    points_m, is_tumour = points(80), np.arange(80) % 4 == 0
    gap_m = np.linalg.norm(points_m[:, None] - points_m, axis=2)
    count = ((gap_m <= 0.01) & (is_tumour[:, None] == is_tumour)).sum(axis=1)
    assert np.array_equal(n_together(points_m, is_tumour, 0.01), count)


def test_an_empty_reading_is_judged_too() -> None:
    own = judged(LabelledPoints(np.empty((0, 3)), np.empty(0, bool)), ErrorRates(missed=0.1))
    assert isinstance(own, LabelledPoints)
    assert own.weight.shape == (0,)


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"missed": 1.0}, "`missed` must be 0 or more and below 1"),
        ({"false_positive": 0.5, "false_negative": 0.5}, "add up to less than 1"),
        ({"together_m": 0.0}, "`together_m` must be above 0"),
    ],
)
def test_rates_out_of_range_are_named(wrong, text) -> None:
    with pytest.raises(ValueError, match=text):
        ErrorRates(**wrong)


def test_the_correlation_of_errors_is_that_of_simulated_pairs() -> None:
    """Pairs of labels of one place: the view errs about it, or each of them slips; 4e5 pairs give it to 0.01."""
    missed, slip, rng = 0.1, 0.05, np.random.default_rng(0)
    common = rng.random(400_000) < missed
    first, second = (common | (rng.random(common.size) < slip) for _ in range(2))
    rates = ErrorRates(missed=missed, false_negative=slip, invented=missed, false_positive=slip)
    assert rates.correlation == pytest.approx(np.corrcoef(first, second)[0, 1], abs=0.01)


def test_labels_count_together_or_in_full_as_they_err() -> None:
    reading = LabelledPoints(points(40, half_m=0.001), np.zeros(40, bool))
    together, mixed = (
        judged(
            reading, ErrorRates(missed=0.1, invented=0.01, false_positive=slip, false_negative=slip)
        ).weight
        for slip in (0.0, 0.2)
    )
    np.testing.assert_allclose(together, 1 / 40)
    assert mixed is not None
    assert (mixed > 3 / 40).all()
    assert (mixed < 1.0).all()

"""The bound on the likelihood, the moderated probability, and labels that may be wrong."""

import numpy as np
import pytest

from mapping import HilbertMap, Lattice, MapSettings, evaluate_map
from mapping.likelihood import (
    bound_curvature,
    expected_label,
    label_log_odds,
    occupancy_probability,
    prior_offset,
)


def log_sigmoid(value):
    return -np.logaddexp(0, -value)


def test_curvature_is_an_eighth_at_zero_and_even():
    np.testing.assert_allclose(bound_curvature([0.0, 1e-9, 1e-5]), 0.125, rtol=1e-9)
    np.testing.assert_allclose(bound_curvature(-2.0), bound_curvature(2.0))


def test_curvature_equals_its_definition_on_both_sides_of_the_series():
    xi = np.array([0.9e-4, 1.1e-4, 0.5, 3.0, 40.0])
    # The plain quotient cancels: at xi = 1e-4 it keeps 12 digits.
    np.testing.assert_allclose(bound_curvature(xi), (1 / (1 + np.exp(-xi)) - 0.5) / (2 * xi), rtol=1e-11)


@pytest.mark.parametrize("xi", [0.0, 0.7, 3.0, 12.0])
def test_the_bound_lies_below_the_likelihood_and_touches_it_at_xi(xi):
    latent = np.linspace(-15, 15, 301)
    bound = latent / 2 - bound_curvature(xi) * (latent**2 - xi**2) - xi / 2 + log_sigmoid(xi)
    # Where the two touch they differ by rounding alone.
    assert np.all(bound <= log_sigmoid(latent) + 1e-12)
    at_xi = xi / 2 - xi / 2 + log_sigmoid(xi)
    assert at_xi == pytest.approx(log_sigmoid(xi))


@pytest.mark.parametrize(("mean", "variance"), [(0.0, 4.0), (-3.0, 14.0), (2.0, 1.0), (-10.0, 14.0)])
def test_probability_agrees_with_monte_carlo(mean, variance):
    draws = np.random.default_rng(0).normal(mean, np.sqrt(variance), 200_000)
    # MacKay's approximation is good to about 0.02 in probability, Monte Carlo to 0.001.
    assert occupancy_probability(mean, variance) == pytest.approx(np.mean(1 / (1 + np.exp(-draws))), abs=0.02)


def test_prior_offset_gives_the_prevalence_back():
    variance = np.array([0.0, 3.0, 14.0])
    np.testing.assert_allclose(occupancy_probability(prior_offset(0.02, variance), variance), 0.02)
    np.testing.assert_array_equal(prior_offset(0.5, variance), 0)


def test_a_label_that_cannot_be_wrong_is_taken_as_it_is():
    labels = np.array([0.0, 1.0])
    np.testing.assert_array_equal(
        expected_label(np.array([50.0, -50.0]), label_log_odds(labels, 0, 0)), labels
    )


def test_expected_label_is_bayes_rule():
    prior, false_positive, false_negative = 0.1, 0.05, 0.2
    logit = np.log(prior / (1 - prior))
    hit = prior * (1 - false_negative) / (prior * (1 - false_negative) + (1 - prior) * false_positive)
    miss = prior * false_negative / (prior * false_negative + (1 - prior) * (1 - false_positive))
    log_odds = label_log_odds(np.array([1.0, 0.0]), false_positive, false_negative)
    np.testing.assert_allclose(expected_label(logit, log_odds), [hit, miss])


@pytest.mark.parametrize("rates", [(-0.1, 0.0), (0.5, 0.5), (np.nan, 0.0)])
def test_rates_that_are_no_rates_are_refused(rates):
    with pytest.raises(ValueError, match="`false_positive_rate` and `false_negative_rate`"):
        MapSettings(false_positive_rate=rates[0], false_negative_rate=rates[1])


def test_knowing_the_error_rates_beats_not_knowing_them():
    box_m = ((-0.03, -0.03, -0.035), (0.03, 0.03, 0.0))
    centre_m = np.array([0.005, 0.0, -0.018])
    scores = {rate: [] for rate in (0.0, 0.05)}
    for seed in range(8):
        rng = np.random.default_rng(seed)
        maps = {
            rate: HilbertMap(
                Lattice.from_box(*box_m, spacing_m=0.01125),
                MapSettings(false_positive_rate=rate, false_negative_rate=rate),
                query=Lattice.from_box(*box_m, spacing_m=0.004),
            )
            for rate in scores
        }
        for _ in range(4):
            points_m = rng.uniform(*box_m, (150, 3))
            label = np.linalg.norm(points_m - centre_m, axis=1) < 0.012
            label ^= rng.random(150) < 0.05
            for tumour_map in maps.values():
                tumour_map.update(points_m, label)
        for rate, tumour_map in maps.items():
            truth = np.linalg.norm(tumour_map.query_points_m() - centre_m, axis=1) < 0.012
            scores[rate].append(evaluate_map(tumour_map.predict_lattice(), truth))
    for measure, sign in (("auprc", 1), ("log_loss", -1)):
        ignorant, informed = (np.mean([getattr(s, measure) for s in scores[rate]]) for rate in (0.0, 0.05))
        assert sign * (informed - ignorant) > 0, measure


@pytest.mark.parametrize("form", ["full", "local", "diagonal"])
@pytest.mark.parametrize("tolerance", [0.0, 3e-6])
@pytest.mark.parametrize("away_m", [0.12, 0.5])
def test_a_reading_beyond_all_hinges_teaches_nothing_and_says_nothing(form, tolerance, away_m, capfd):
    lattice = Lattice.from_box(np.zeros(3), np.full(3, 0.05), spacing_m=0.01)
    hilbert_map = HilbertMap(lattice, MapSettings(form=form, tolerance=tolerance))
    before = hilbert_map.predict(lattice.points_m())
    report = hilbert_map.update(np.full((3, 3), away_m), np.array([True, False, True]))
    after = hilbert_map.predict(lattice.points_m())
    assert (report.n_points, report.n_occupied, len(report.curvature)) == (3, 2, 3)
    np.testing.assert_allclose(after.latent_mean, before.latent_mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(after.latent_variance, before.latent_variance, rtol=1e-9)
    hilbert_map.update(np.full((3, 3), 0.02), np.array([True, False, True]))
    assert capfd.readouterr() == ("", "")

"""The local classifier against a posterior found by another way: a minimiser, and dense algebra at the mode."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit

from mapping import DetailSettings
from mapping.near_tumour.local_classifier import Neighbours, classify, classify_together

RATES = [(0.0, 0.0), (0.05, 0.05), (0.02, 0.0)]


def posterior(place_m, points_m, is_tumour, settings, rates):
    """Mean and variance of the latent at one place, by minimising the negative log posterior in whitened weights."""
    everything_m = np.vstack([place_m, points_m])
    squares = ((everything_m[:, None] - everything_m) ** 2).sum(axis=2)
    covariance = settings.variance * np.exp(-squares / (2 * settings.length_m**2))
    of_points, across = covariance[1:, 1:] + 1e-9 * np.eye(len(points_m)), covariance[0, 1:]
    root = np.linalg.cholesky(of_points)
    p_plus, p_minus = rates

    def said(latent):
        return p_plus + (1 - p_plus - p_minus) * expit(latent)

    def cost(weights):
        chance = said(settings.prior_mean + root @ weights)
        return 0.5 * weights @ weights - np.log(np.where(is_tumour, chance, 1 - chance)).sum()

    starts = [
        np.zeros(len(points_m)),
        np.linalg.solve(root, np.where(is_tumour, 3.0, -3.0) - settings.prior_mean),
    ]
    best = min(
        (minimize(cost, start, method="BFGS", options={"gtol": 1e-8}) for start in starts),
        key=lambda r: r.fun,
    )
    latent = settings.prior_mean + root @ best.x
    chance, slope = said(latent), (1 - p_plus - p_minus) * expit(latent) * (1 - expit(latent))
    information = slope**2 / (chance * (1 - chance))
    system = of_points + np.diag(1 / information)
    mean = settings.prior_mean + across @ np.linalg.solve(of_points, latent - settings.prior_mean)
    return mean, settings.variance - across @ np.linalg.solve(system, across)


@pytest.mark.parametrize("rates", RATES)
def test_mean_and_variance_are_those_of_a_posterior_found_by_a_minimiser(rates):
    rng, settings = np.random.default_rng(0), DetailSettings(n_neighbours=12)
    places_m = rng.uniform(-0.02, 0.02, (12, 3))
    points_m = places_m[:, None] + rng.uniform(-0.009, 0.009, (12, 12, 3))
    is_tumour = np.linalg.norm(points_m - points_m[:, :1], axis=2) < 0.008
    mean, variance = classify(places_m, Neighbours(points_m, is_tumour, *rates, 1.0), settings)
    for i in range(len(places_m)):
        expected = posterior(places_m[i], points_m[i], is_tumour[i], settings, rates)
        # Some rounds in single precision; the floor under the curvature moves a variance by up to 0.4 %.
        np.testing.assert_allclose((mean[i], variance[i]), expected, rtol=0.004, atol=0.03)


def test_far_from_its_labels_it_falls_back_to_the_prior():
    settings, rng = DetailSettings(), np.random.default_rng(1)
    points_m = rng.uniform(-0.004, 0.004, (1, 24, 3))
    far_m = np.array([[0.08, 0.0, 0.0]])
    mean, variance = classify(
        far_m, Neighbours(points_m, np.ones((1, 24), dtype=bool), 0.0, 0.0, 1.0), settings
    )
    np.testing.assert_allclose((mean[0], variance[0]), (settings.prior_mean, settings.variance), rtol=1e-6)


def test_a_place_has_the_same_bytes_whatever_else_is_asked_with_it():
    settings, rng = DetailSettings(), np.random.default_rng(2)
    places_m = rng.uniform(-0.02, 0.02, (1500, 3))
    points_m = places_m[:, None] + rng.uniform(-0.009, 0.009, (1500, 24, 3))
    is_tumour = rng.random((1500, 24)) < 0.5
    neighbours = Neighbours(points_m, is_tumour, 0.0, 0.0, 1.0)
    together = classify(places_m, neighbours, settings)
    for some in (slice(3, 4), slice(1000, 1100), slice(None, None, 7)):
        alone = classify(places_m[some], neighbours.part(some), settings)
        for one, other in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one, other[some])


@pytest.mark.parametrize("rates", RATES)
def test_places_about_a_centre_have_the_posterior_of_its_neighbours(rates):
    rng, settings = np.random.default_rng(3), DetailSettings(n_neighbours=12)
    centres_m = rng.uniform(-0.02, 0.02, (4, 3))
    points_m = centres_m[:, None] + rng.uniform(-0.009, 0.009, (4, 12, 3))
    is_tumour = np.linalg.norm(points_m - points_m[:, :1], axis=2) < 0.008
    centre_of = np.array([2, 0, 3, 3, 1, 2, 0])
    places_m = centres_m[centre_of] + rng.uniform(-0.003, 0.003, (7, 3))
    neighbours = Neighbours(points_m, is_tumour, *rates, 1.0)
    mean, variance = classify_together(places_m, centres_m, centre_of, neighbours, settings)
    for i, centre in enumerate(centre_of):
        expected = posterior(places_m[i], points_m[centre], is_tumour[centre], settings, rates)
        # The floor under the curvature moves a variance by up to 0.5 %.
        np.testing.assert_allclose((mean[i], variance[i]), expected, rtol=0.006, atol=0.03)


def test_places_about_a_centre_have_the_same_bytes_whatever_else_is_asked():
    settings, rng = DetailSettings(), np.random.default_rng(4)
    centres_m = rng.uniform(-0.02, 0.02, (1200, 3))
    points_m = centres_m[:, None] + rng.uniform(-0.009, 0.009, (1200, 24, 3))
    is_tumour = rng.random((1200, 24)) < 0.5
    neighbours = Neighbours(points_m, is_tumour, 0.02, 0.05, 1.0)
    centre_of = rng.integers(1200, size=3000)
    places_m = centres_m[centre_of] + rng.uniform(-0.003, 0.003, (3000, 3))
    together = classify_together(places_m, centres_m, centre_of, neighbours, settings)
    at_centres = classify_together(centres_m, centres_m, np.arange(1200), neighbours, settings)
    for one, other in zip(at_centres, classify(centres_m, neighbours, settings), strict=True):
        # Sums of large numbers in single precision.
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=0.1)
    some = np.flatnonzero(centre_of >= 1100)
    last = np.arange(1100, 1200)
    alone = classify_together(
        places_m[some], centres_m[last], centre_of[some] - 1100, neighbours.part(last), settings
    )
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other[some])

"""Draws of whole maps agree with the moments that the map states."""

import numpy as np
import pytest

from mapping import HilbertMap, Lattice, MapSettings

BOX_M = ((-0.03, -0.03, -0.035), (0.03, 0.03, 0.0))
N_SAMPLES = 4000


def make_map(**changes):
    return HilbertMap(
        Lattice.from_box(*BOX_M, spacing_m=0.01125),
        MapSettings(**changes),
        query=Lattice.from_box(*BOX_M, spacing_m=0.01),
    )


def learn(tumour_map, n_readings):
    rng = np.random.default_rng(3)
    for _ in range(n_readings):
        points_m = rng.uniform((-0.03, -0.03, -0.035), (0.01, 0.01, 0.0), (100, 3))
        tumour_map.update(points_m, np.linalg.norm(points_m - (-0.01, -0.01, -0.02), axis=1) < 0.012)


def assert_draws_agree(tumour_map):
    draws, belief = tumour_map.sample_lattice(), tumour_map.predict_lattice()
    standard_error = belief.latent_std / np.sqrt(N_SAMPLES)
    # 252 points: five standard errors leave a chance of 1e-4 that any of them strays by luck.
    assert np.all(np.abs(draws.mean(axis=0) - belief.latent_mean) < 5 * standard_error + 1e-9)
    np.testing.assert_allclose(
        draws.var(axis=0), belief.latent_variance, rtol=5 * np.sqrt(2 / N_SAMPLES), atol=1e-6
    )


@pytest.mark.parametrize(("form", "n_before"), [("full", 0), ("full", 2), ("local", 0), ("diagonal", 2)])
def test_mean_and_variance_of_the_draws_are_those_of_the_map(form, n_before):
    tumour_map = make_map(form=form)
    learn(tumour_map, n_before)
    tumour_map.carry_samples(N_SAMPLES, rng=np.random.default_rng(0))
    assert_draws_agree(tumour_map)
    learn(tumour_map, 3)
    assert_draws_agree(tumour_map)


def test_draws_carry_the_covariance_between_points():
    tumour_map = make_map()
    tumour_map.carry_samples(N_SAMPLES, rng=np.random.default_rng(1))
    learn(tumour_map, 3)
    query_m = tumour_map.query_points_m()
    Phi = np.exp(
        -tumour_map.settings.gamma_per_m2
        * ((query_m[:, None] - tumour_map.hinges.points_m()) ** 2).sum(axis=2)
    )
    covariance = Phi @ tumour_map.belief.covariance.matrix @ Phi.T
    scale = np.sqrt(np.diag(covariance))
    # A sample correlation of 4,000 draws strays by 1/sqrt(4000) = 0.016; five of those over 63,000 pairs.
    difference = (np.cov(tumour_map.sample_lattice().T) - covariance) / np.outer(scale, scale)
    assert np.abs(difference).max() < 0.1


def test_the_same_generator_gives_the_same_draws():
    first, second = make_map(), make_map()
    for tumour_map in (first, second):
        tumour_map.carry_samples(5, rng=np.random.default_rng(7))
        learn(tumour_map, 2)
    np.testing.assert_array_equal(first.sample_lattice(), second.sample_lattice())


def test_draws_that_nobody_asked_for_are_refused_with_the_remedy():
    with pytest.raises(ValueError, match="carry_samples"):
        make_map().sample_lattice()
    with pytest.raises(ValueError, match="at least 1"):
        make_map().carry_samples(0, rng=np.random.default_rng(0))

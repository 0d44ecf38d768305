"""Draws of whole detailed maps: the coarse map's, moved to the mean and the variance of the prediction."""

import numpy as np
import pytest
from detailed_maps import make_coarse, make_detailed, readings

N_SAMPLES = 2000


@pytest.mark.parametrize(
    ("form", "n_before"), [("full", 0), ("full", 3), ("local", 0), ("diagonal", 1), ("diagonal", 3)]
)
def test_mean_and_variance_of_the_draws_are_the_maps(form, n_before):
    detailed = make_detailed(form=form)
    for number, reading in enumerate(readings(5)):
        if number == n_before:
            detailed.carry_samples(N_SAMPLES, rng=np.random.default_rng(0))
        detailed.update(*reading)
    draws, belief = detailed.sample_lattice(), detailed.predict_lattice()
    mean, deviation = belief.latent_mean, belief.latent_std
    # Of some 600 points five standard errors leave a chance of 3e-4 that any of them strays by luck.
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5 * deviation / np.sqrt(N_SAMPLES) + 1e-9)
    np.testing.assert_allclose(draws.var(axis=0), deviation**2, rtol=5 * np.sqrt(2 / N_SAMPLES))


def test_neighbours_covary_as_in_the_coarse_map():
    coarse, detailed = make_coarse(), make_detailed()
    for each in (coarse, detailed):
        each.carry_samples(N_SAMPLES, rng=np.random.default_rng(5))
        for reading in readings(3):
            each.update(*reading)
    found, expected = (np.corrcoef(each.sample_lattice().T) for each in (detailed, coarse))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_the_same_generator_gives_the_same_draws_and_carrying_them_changes_no_belief():
    # In double precision: with more columns a product of BLAS may round differently, on some processors.
    first, second, without = (make_detailed(tolerance=1e-7) for _ in range(3))
    for each in (first, second):
        each.carry_samples(5, rng=np.random.default_rng(6))
    for reading in readings(4):
        for each in (first, second, without):
            each.update(*reading)
    np.testing.assert_array_equal(first.sample_lattice(), second.sample_lattice())
    # The draws are columns of a reading's products, which therefore round differently.
    np.testing.assert_allclose(
        first.predict_lattice().score, without.predict_lattice().score, rtol=1e-9, atol=1e-9
    )


def test_draws_that_are_not_carried_are_refused_with_the_remedy():
    with pytest.raises(ValueError, match="carry_samples"):
        make_detailed().sample_lattice()
    with pytest.raises(ValueError, match="at least 1"):
        make_detailed().carry_samples(0, rng=np.random.default_rng(0))
    local = make_detailed(form="local")
    for reading in readings(2):
        local.update(*reading)
    with pytest.raises(ValueError, match="before its first reading"):
        local.carry_samples(3, rng=np.random.default_rng(0))

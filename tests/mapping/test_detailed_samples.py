"""Draws of whole maps with finer ones in them: of the coarse posterior outside the boxes, of the finer inside."""

import numpy as np
import pytest
from dense_reference import DenseReference, dense_features
from detailed_maps import HIGH_M, LOW_M, TUMOUR_M, in_boxes, make_coarse, make_detailed, readings

from mapping import InsetSettings, Lattice

N_SAMPLES = 2000


def assert_draws_agree(detailed, some):
    draws, belief = detailed.sample_lattice()[:, some], detailed.predict_lattice()
    mean, deviation = belief.latent_mean[some], belief.latent_std[some]
    # Of some 500 points five standard errors leave a chance of 3e-4 that any of them strays by luck.
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5 * deviation / np.sqrt(N_SAMPLES))
    np.testing.assert_allclose(draws.var(axis=0), deviation**2, rtol=5 * np.sqrt(2 / N_SAMPLES))


@pytest.mark.parametrize(
    ("form", "n_before"), [("full", 0), ("full", 3), ("local", 0), ("diagonal", 1), ("diagonal", 3)]
)
def test_mean_and_variance_of_the_draws_are_the_maps_at_coarse_and_at_fine_points(form, n_before):
    detailed = make_detailed(form=form)
    for number, reading in enumerate(readings(5)):
        if number == n_before:
            assert bool(detailed.boxes) == (n_before == 3)
            detailed.carry_samples(N_SAMPLES, rng=np.random.default_rng(0))
        detailed.update(*reading)
    inside = in_boxes(detailed)
    assert 50 < inside.sum() < len(inside) - 50
    for some in (inside, ~inside):
        assert_draws_agree(detailed, some)


def test_draws_follow_a_revision_of_the_finer_map():
    detailed = make_detailed()
    detailed.carry_samples(N_SAMPLES, rng=np.random.default_rng(1))
    for reading in readings(4):
        detailed.update(*reading)
    before = detailed.predict_lattice().latent_mean
    detailed.revise()
    inside = in_boxes(detailed)
    assert np.abs(detailed.predict_lattice().latent_mean - before)[inside].max() > 0.1
    assert_draws_agree(detailed, inside)


def test_draws_inside_a_box_covary_as_a_dense_posterior_of_its_hinges_says():
    insets = InsetSettings(tolerance=0.0)
    detailed = make_detailed(insets=insets, tolerance=0.0)
    detailed.carry_samples(N_SAMPLES, rng=np.random.default_rng(2))
    rng = np.random.default_rng(3)
    # The same tumour points in both readings, so that the box stays where it is.
    tumour_m = TUMOUR_M + rng.uniform(-0.002, 0.002, (10, 3))
    told = [np.vstack([tumour_m, rng.uniform(LOW_M, HIGH_M, (150, 3))]) for _ in range(2)]
    for points_m in told:
        detailed.update(points_m, np.arange(160) < 10)
    (box,), spacing_m, settings = detailed.boxes, insets.hinge_spacing_m, detailed.settings
    reference = DenseReference(
        Lattice.from_box(box.low_m - spacing_m, box.high_m + spacing_m, spacing_m=spacing_m).points_m(),
        gamma_per_m2=settings.gamma_per_m2 * (settings.hinge_spacing_m / spacing_m) ** 2,
        weight_variance=settings.weight_variance,
        prevalence=settings.prior_prevalence,
        n_iterations=settings.n_em_iterations,
    )
    # A reading with which a map is laid in is fitted again, which of a single one is as many rounds once more.
    for points_m, n_fits in zip(told, (2, 1), strict=True):
        near = box.holds(points_m, spacing_m)
        reference.n_iterations = n_fits * settings.n_em_iterations
        reference.update(points_m[near], (np.arange(160) < 10)[near].astype(float))
    inside = in_boxes(detailed)
    points_m = detailed.query_points_m()[inside]
    mean, variance, _ = reference.predict(points_m)
    belief = detailed.predict_lattice()
    # What the exact path promises against dense algebra.
    np.testing.assert_allclose(belief.latent_mean[inside], mean, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(belief.latent_variance[inside], variance, rtol=1e-6)
    Phi = dense_features(points_m, reference.hinges_m, reference.gamma_per_m2)
    scale = np.sqrt(np.outer(variance, variance))
    expected = Phi @ reference.covariance @ Phi.T / scale
    found = np.cov(detailed.sample_lattice()[:, inside].T) / scale
    next_to_one_another = np.linalg.norm(points_m[:, None] - points_m, axis=2) < 0.0065
    np.fill_diagonal(next_to_one_another, False)
    assert np.ptp(expected[next_to_one_another]) > 0.3  # they differ by far more than the draws may
    # The standard error of a covariance is sqrt((1 + rho^2) / S) of the deviations, at most sqrt(2 / S).
    np.testing.assert_allclose(found, expected, atol=5 * np.sqrt(2 / N_SAMPLES))


def test_draws_inside_and_outside_a_box_are_independent():
    detailed = make_detailed()
    detailed.carry_samples(N_SAMPLES, rng=np.random.default_rng(4))
    for reading in readings(3):
        detailed.update(*reading)
    draws, inside = detailed.sample_lattice(), in_boxes(detailed)
    standard = (draws - draws.mean(axis=0)) / draws.std(axis=0)
    correlation = standard[:, inside].T @ standard[:, ~inside] / N_SAMPLES
    # Some 50,000 pairs: 5.5 standard errors leave a chance of 2e-3 that any strays by luck.
    assert np.abs(correlation).max() < 5.5 / np.sqrt(N_SAMPLES)


def test_outside_the_boxes_the_draws_are_those_of_a_coarse_map_with_the_same_generator():
    coarse, detailed = make_coarse(), make_detailed()
    for each in (coarse, detailed):
        each.carry_samples(5, rng=np.random.default_rng(5))
        for reading in readings(3):
            each.update(*reading)
    outside = ~in_boxes(detailed)
    draws = detailed.sample_lattice()
    np.testing.assert_array_equal(draws[:, outside], coarse.sample_lattice()[:, outside])
    assert not np.any(draws[:, ~outside] == coarse.sample_lattice()[:, ~outside])


def test_the_same_generator_gives_the_same_draws_and_carrying_them_changes_no_belief():
    first, second, without = make_detailed(), make_detailed(), make_detailed()
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

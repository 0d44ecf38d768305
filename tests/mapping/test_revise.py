"""Readings fitted again in the light of all others: the order of the readings loses its part."""

import numpy as np
import pytest
from dense_reference import dense_features

from mapping import HilbertMap, Lattice, MapSettings

BOX_M = ((-0.03, -0.03, -0.035), (0.03, 0.03, 0.0))


def make_map(**changes):
    settings = MapSettings(**changes)
    query = Lattice.from_box(*BOX_M, spacing_m=0.008)
    return HilbertMap(Lattice.from_box(*BOX_M, spacing_m=0.01125), settings, query=query)


def readings():
    rng = np.random.default_rng(0)
    for _ in range(6):
        low_m = rng.uniform((-0.03, -0.03, -0.035), (0.01, 0.01, -0.02))
        points_m = low_m + rng.uniform(0, 0.025, (120, 3))
        yield points_m, np.linalg.norm(points_m - (0.0, 0.0, -0.02), axis=1) < 0.01


def learn(tumour_map, told):
    for points_m, is_occupied in told:
        tumour_map.update(points_m, is_occupied)
    return tumour_map


def order_gap(first, second):
    return np.abs(first.predict_lattice().probability - second.predict_lattice().probability).max()


def test_two_orders_of_the_same_readings_agree_once_revised():
    told = list(readings())
    paper = {"prior_prevalence": 0.5, "weight_variance": 4.0, "gamma_per_m2": 5 / 0.03**2}
    forward, backward = (learn(make_map(**paper), order) for order in (told, told[::-1]))
    # Each reading is taken in with the xi of its moment, so the order shows before the revision.
    assert order_gap(forward, backward) > 0.03
    for tumour_map in (forward, backward):
        tumour_map.revise(4)
    assert order_gap(forward, backward) < 0.02


def test_sweeps_bring_the_orders_of_a_low_prior_closer_each_time():
    told = list(readings())
    forward, backward = (learn(make_map(prior_prevalence=0.02), order) for order in (told, told[::-1]))
    gaps = [order_gap(forward, backward)]
    for _ in range(3):
        forward.revise()
        backward.revise()
        gaps.append(order_gap(forward, backward))
    # The rounds shrink a xi slowly where the prior's mean is far from zero, but every sweep helps.
    assert gaps[0] > gaps[1] > gaps[2] > gaps[3]
    assert gaps[3] < gaps[0] / 2


def test_a_revised_belief_is_the_posterior_under_its_lambdas():
    told = list(readings())
    tumour_map = learn(make_map(tolerance=0.0), told)
    tumour_map.revise(2)
    hinges_m, settings = tumour_map.hinges.points_m(), tumour_map.settings
    precision = np.eye(len(hinges_m)) / settings.weight_variance
    information = np.zeros(len(hinges_m))
    for held in tumour_map.belief.held:
        Phi = dense_features(held.points_m, hinges_m, settings.gamma_per_m2)
        precision += 2 * Phi.T @ (held.curvature[:, None] * Phi)
        information += Phi.T @ (held.labels - 0.5 - 2 * held.curvature * held.offset)
    Sigma = np.linalg.inv(precision)
    # Rounding of a few rises and falls of variances up to 4.
    np.testing.assert_allclose(tumour_map.belief.covariance.matrix, Sigma, atol=1e-9)
    np.testing.assert_allclose(tumour_map.belief.mean, Sigma @ information, atol=1e-7)


def test_draws_follow_a_revision():
    tumour_map = make_map()
    tumour_map.carry_samples(4000, rng=np.random.default_rng(0))
    learn(tumour_map, readings())
    tumour_map.revise()
    draws, belief = tumour_map.sample_lattice(), tumour_map.predict_lattice()
    # Five standard errors of 4,000 draws.
    assert np.all(
        np.abs(draws.mean(axis=0) - belief.latent_mean) < 5 * belief.latent_std / np.sqrt(4000) + 1e-9
    )
    np.testing.assert_allclose(draws.var(axis=0), belief.latent_variance, rtol=5 * np.sqrt(2 / 4000))


def test_identical_readings_add_their_precisions_and_never_raise_a_variance():
    tumour_map = make_map(prior_prevalence=0.5)
    points_m, is_occupied = next(iter(readings()))
    before = tumour_map.predict(points_m)
    for _ in range(5):
        tumour_map.update(points_m, is_occupied)
        after = tumour_map.predict(points_m)
        # 1e-6 is the tolerance of the default path.
        assert np.all(after.latent_variance <= before.latent_variance + 1e-6)
        assert np.all((after.latent_mean - before.latent_mean)[~is_occupied].mean() < 0)
        before = after


def test_the_diagonal_form_refuses_with_the_remedy():
    with pytest.raises(ValueError, match="form='full'"):
        make_map(form="diagonal").revise()

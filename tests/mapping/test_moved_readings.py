"""Readings that are moved at once: the belief is the posterior of where they lie now."""

import numpy as np
import pytest
from dense_reference import dense_features

from mapping import DetailedMap, HilbertMap, LabelledPoints, Lattice, MapSettings, laid_anew
from mapping.belief.pair_features import PairFeatures
from mapping.kernel import HingeFeatures

BOX_M = ((-0.03, -0.03, -0.035), (0.03, 0.02, 0.0))
SPACING_M = 0.01125


def make_map(**changes):
    hinges = Lattice.from_box(*BOX_M, spacing_m=SPACING_M)
    # A corner is left out, so that weights and hinges are numbered differently.
    keep = np.linalg.norm(hinges.points_m() - BOX_M[0], axis=1) > 0.02
    query = Lattice.from_box(*BOX_M, spacing_m=0.008)
    return HilbertMap(hinges, MapSettings(**changes), query=query, hinge_mask=keep)


def readings(n=6, *, seed=0):
    rng = np.random.default_rng(seed)
    for _ in range(n):
        low_m = rng.uniform((-0.03, -0.03, -0.035), (0.01, 0.01, -0.02))
        points_m = low_m + rng.uniform(0, 0.025, (120, 3))
        yield points_m, np.linalg.norm(points_m - (0.0, 0.0, -0.02), axis=1) < 0.01


def learn(tumour_map, told, **doubts):
    for points_m, is_occupied in told:
        tumour_map.update(points_m, is_occupied, **doubts)
    return tumour_map


def moved(told, shift_m):
    return [points_m + shift_m for points_m, _ in told]


def test_sums_over_middles_are_those_over_pairs():
    rng, tumour_map = np.random.default_rng(1), make_map()
    features: HingeFeatures = tumour_map._features
    hinges_m = tumour_map.hinges.points_m()[features.weight_of_hinge >= 0]
    pairs = PairFeatures(features)
    some = [(points_m, rng.uniform(0.0, 0.25, len(points_m))) for points_m, _ in readings(3)]
    expected = np.zeros((len(hinges_m), len(hinges_m)))
    for points_m, weight in some:
        Phi = dense_features(points_m, hinges_m, features.gamma_per_m2)
        expected += Phi.T @ (weight[:, None] * Phi)
    # Middles are left out whose features are below 1e-12.
    np.testing.assert_allclose(pairs.precision(some), expected, atol=1e-9)
    root = rng.standard_normal(expected.shape)
    query = tumour_map.query.lattice
    Phi = dense_features(query.points_m(), hinges_m, features.gamma_per_m2)
    variance = np.einsum("nh,nh->n", Phi @ (root @ root.T), Phi)
    found = pairs.variance_on_lattice(root @ root.T, query)
    np.testing.assert_allclose(found.ravel(), variance, rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("doubts", [{}, {"log_odds": np.full(120, 1.5), "weight": np.full(120, 0.3)}])
def test_a_moved_belief_is_the_posterior_of_where_the_readings_lie(doubts):
    told, shift_m = list(readings()), np.array([0.004, -0.002, 0.003])
    tumour_map = learn(make_map(tolerance=0.0), told, **doubts)
    before = [(held.curvature, held.labels) for held in tumour_map.belief.held]
    assert tumour_map.lay(moved(told, shift_m))
    hinges_m = tumour_map.hinges.points_m()[tumour_map._features.weight_of_hinge >= 0]
    settings = tumour_map.settings
    precision = np.eye(len(hinges_m)) / settings.weight_variance
    information = np.zeros(len(hinges_m))
    for held, (points_m, _), (curvature, labels) in zip(tumour_map.belief.held, told, before, strict=True):
        np.testing.assert_array_equal(held.points_m, points_m + shift_m)
        np.testing.assert_array_equal(held.curvature, curvature)
        np.testing.assert_array_equal(held.labels, labels)
        Phi = dense_features(held.points_m, hinges_m, settings.gamma_per_m2)
        weight = held.evidence.weight
        precision += 2 * Phi.T @ ((weight * curvature)[:, None] * Phi)
        information += Phi.T @ (weight * (labels - 0.5 - 2 * curvature * held.offset))
    Sigma = np.linalg.inv(precision)
    np.testing.assert_allclose(tumour_map.belief.covariance.matrix, Sigma, atol=1e-9)
    np.testing.assert_allclose(tumour_map.belief.mean, Sigma @ information, atol=1e-7)
    # The carried variance on the lattice follows from it.
    lattice = tumour_map.predict_lattice()
    anywhere = tumour_map.predict(tumour_map.query_points_m())
    np.testing.assert_allclose(lattice.latent_variance, anywhere.latent_variance, atol=1e-7)
    np.testing.assert_allclose(lattice.latent_mean, anywhere.latent_mean, atol=1e-7)


def test_readings_that_stay_leave_a_belief_that_is_settled_as_it_is():
    told = list(readings())
    tumour_map = learn(make_map(), told)
    before = tumour_map.predict_lattice()
    assert tumour_map.lay(moved(told, 0.0))
    after = tumour_map.predict_lattice()
    # Readings learnt in turn leave out what the tolerance of 3e-6 allows.
    assert np.abs(after.probability - before.probability).max() < 2e-3


def test_a_moved_map_is_near_the_one_that_is_taught_anew_and_goes_on_alike():
    told, more, shift_m = list(readings()), list(readings(2, seed=7)), np.array([0.003, 0.0, -0.002])
    at_once = learn(make_map(), told)
    assert at_once.lay(moved(told, shift_m))
    anew = learn(make_map(), [(points_m + shift_m, labels) for points_m, labels in told])
    still = learn(make_map(), told)
    for each in (at_once, anew, still):
        learn(each, more)
    mine, yours, old = (each.predict_lattice().probability for each in (at_once, anew, still))
    # The xi of a label are those of its old place: what that changes is small beside the move.
    assert np.abs(mine - yours).mean() < 0.15 * np.abs(old - yours).mean()


def test_draws_are_of_the_moved_belief():
    told = list(readings())
    tumour_map = make_map()
    tumour_map.carry_samples(4000, rng=np.random.default_rng(0))
    learn(tumour_map, told)
    assert tumour_map.lay(moved(told, np.array([0.003, 0.0, 0.0])))
    draws, belief = tumour_map.sample_lattice(), tumour_map.predict_lattice()
    # Five standard errors of 4,000 draws.
    assert np.all(
        np.abs(draws.mean(axis=0) - belief.latent_mean) < 5 * belief.latent_std / np.sqrt(4000) + 1e-9
    )
    np.testing.assert_allclose(draws.var(axis=0), belief.latent_variance, rtol=5 * np.sqrt(2 / 4000))


@pytest.mark.parametrize("form", ["local", "diagonal"])
def test_a_form_that_cannot_says_so_and_stays(form):
    told = list(readings(2))
    tumour_map = learn(make_map(form=form), told)
    before = tumour_map.predict_lattice()
    assert not tumour_map.lay(moved(told, 0.01))
    np.testing.assert_array_equal(tumour_map.predict_lattice().latent_mean, before.latent_mean)


def test_a_reading_beyond_all_hinges_cannot_be_moved():
    told = list(readings(2))
    tumour_map = learn(make_map(), [*told, (np.full((3, 3), 5.0), np.zeros(3, dtype=bool))])
    before = tumour_map.predict_lattice()
    assert not tumour_map.lay([*moved(told, 0.001), np.zeros((3, 3))])
    np.testing.assert_array_equal(tumour_map.predict_lattice().latent_mean, before.latent_mean)


def test_a_map_in_detail_moves_both_its_maps_and_takes_in_what_is_new():
    told, shift_m = list(readings(7)), np.array([0.004, 0.0, -0.001])
    new = told.pop()
    detailed, coarse = DetailedMap(make_map()), make_map()
    for points_m, labels in told:
        detailed.update(points_m, labels)
        coarse.update(points_m, labels)
    now = [LabelledPoints(points_m + shift_m, labels) for points_m, labels in told]
    assert detailed.lay_labels([*now, LabelledPoints(*new)], is_far=True)
    assert coarse.lay([each.points_m for each in now])
    coarse.update(*new)
    np.testing.assert_array_equal(detailed.coarse.belief.mean, coarse.belief.mean)
    # What decides near tumour is that of a map which never knew the old places.
    fresh = DetailedMap(make_map())
    assert fresh.lay_labels([*now, LabelledPoints(*new)])
    for mine, yours in zip(
        detailed._detail.answers().__dict__.values(), fresh._detail.answers().__dict__.values(), strict=True
    ):
        np.testing.assert_array_equal(mine, yours)


def test_a_map_in_detail_whose_coarse_map_cannot_is_taught_anew():
    told = list(readings(5))
    now = [LabelledPoints(points_m + 0.004, labels) for points_m, labels in told]
    detailed = DetailedMap(make_map(form="local"))
    for points_m, labels in told[:4]:
        detailed.update(points_m, labels)
    before = detailed.predict_lattice().score
    assert not detailed.lay_labels(now, is_far=True)
    np.testing.assert_array_equal(detailed.predict_lattice().score, before)
    laid = laid_anew(detailed, now, lambda: DetailedMap(make_map(form="local")), is_far=True)
    assert laid is not detailed
    np.testing.assert_array_equal(
        laid.state()["reading_points_m"], np.concatenate([each.points_m for each in now])
    )

"""The baselines against brute force, numerical integration and planted truths."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from planner_situations import box_points, make_situation
from scipy.integrate import quad
from scipy.special import entr, expit
from scipy.stats import norm

from mapping import HilbertMap, Lattice, MapSettings
from planner import PlannerError, make_planner, upper_confidence_bound
from planner.acquisition import log_probability_of_improvement, mutual_information
from sim.episode.target_belief import draws_of

POINTS = box_points()


def first(name, situation, **options):
    return next(iter(make_planner(name, **options).rank(situation)))


def seen(situation, pose):
    """Which search points the cone of a pose holds, by the cone itself."""
    workspace = situation.workspace
    return situation.cone.contains(
        situation.search_points_m, workspace.positions_m[pose], workspace.normals[pose]
    )


def brute_force(situation, weights):
    return np.array([weights[seen(situation, pose)].sum() for pose in range(situation.workspace.n_poses)])


# --- the formulas ---


@pytest.mark.parametrize(("mean", "variance"), [(0.3, 0.5), (-4.0, 2.0), (1.0, 1e-3), (-30.0, 0.1)])
def test_probability_of_improvement_is_the_normal_tail(mean, variance):
    value = log_probability_of_improvement([mean], [variance], incumbent=0.4, xi=0.05)
    assert value[0] == pytest.approx(norm.logsf(0.45, mean, np.sqrt(variance)), rel=1e-9)


@pytest.mark.parametrize(
    ("mean", "variance"), [(0.0, 1.0), (-4.0, 2.0), (3.0, 9.0), (-1.0, 1e-4), (0.0, 100.0)]
)
def test_mutual_information_agrees_with_numerical_integration(mean, variance):
    def entropy(p):
        return entr(p) + entr(1 - p)

    def expectation(function):
        deviation = np.sqrt(variance)
        return quad(
            lambda z: function(expit(mean + deviation * z)) * norm.pdf(z), -9, 9, limit=400, epsabs=1e-12
        )[0]

    expected = entropy(expectation(lambda p: p)) - expectation(entropy)
    assert mutual_information([mean], [variance])[0] == pytest.approx(expected, abs=2e-5)


def test_mutual_information_is_nothing_where_the_latent_is_known_and_at_most_one_bit():
    known = mutual_information(np.linspace(-5, 5, 11), np.zeros(11))
    unknown = mutual_information(np.zeros(3), [1.0, 100.0, 1e4])
    assert known.max() < 1e-9
    assert (np.diff(unknown) > 0).all()
    assert unknown.max() <= np.log(2.0)


def test_the_bound_of_no_deviations_is_the_mean():
    mean, variance = np.array([0.2, -1.0]), np.array([4.0, 9.0])
    assert upper_confidence_bound(mean, variance, beta=0.0).tolist() == mean.tolist()
    assert upper_confidence_bound(mean, variance, beta=2.0).tolist() == [4.2, 5.0]


# --- points ---


def test_a_larger_beta_leaves_a_likely_place_for_an_uncertain_one():
    # One place is likely and known, another unlikely and unknown.
    mean, variance = np.full(len(POINTS), -5.0), np.full(len(POINTS), 0.01)
    likely, unknown = 30, len(POINTS) - 30
    mean[likely], mean[unknown], variance[unknown] = 1.0, -1.0, 4.0
    situation = make_situation(mean=mean, variance=variance, sensed=(0,))
    assert seen(situation, first("upper-confidence-bound", situation, beta=0.5))[likely]
    assert seen(situation, first("upper-confidence-bound", situation, beta=3.0))[unknown]
    # Nothing but the unknown place can exceed what is known to be the highest.
    assert seen(situation, first("probability-of-improvement", situation, xi=0.5))[unknown]


def test_thompson_sampling_shares_its_choices_among_equals():
    mean = np.full(len(POINTS), -40.0)
    places = (30, len(POINTS) - 30)
    mean[list(places)] = 0.0
    variance = np.full(len(POINTS), 1.0)
    chosen = [
        seen(make_situation(mean=mean, variance=variance, sensed=(0,), seed=seed), pose)[
            list(places)
        ].tolist()
        for seed in range(200)
        for pose in [
            first("thompson-sampling", make_situation(mean=mean, variance=variance, sensed=(0,), seed=seed))
        ]
    ]
    n_first = sum(sees == [True, False] for sees in chosen)
    assert n_first + sum(sees == [False, True] for sees in chosen) == 200
    assert 70 <= n_first <= 130  # five deviations of a fair coin are 35


def test_draws_of_a_map_have_its_mean_and_its_covariance():
    query = Lattice.from_box(np.zeros(3), np.full(3, 0.02), spacing_m=0.01)
    hinges = Lattice.from_box(np.full(3, -0.01), np.full(3, 0.03), spacing_m=0.01)
    tumour_map = HilbertMap(hinges, MapSettings(), query=query)
    tumour_map.update([[0.01, 0.01, 0.01], [0.0, 0.0, 0.0]], [True, False])
    draw = draws_of(tumour_map)
    assert draw is not None
    rng = np.random.default_rng(5)
    draws = np.array([draw(rng) for _ in range(3000)])
    prediction = tumour_map.predict_lattice()
    error = prediction.latent_std / np.sqrt(len(draws))
    assert (np.abs(draws.mean(axis=0) - prediction.latent_mean) < 5 * error).all()
    assert np.allclose(draws.var(axis=0), prediction.latent_variance, rtol=0.15)
    correlation = np.corrcoef(draws[:, 0], draws[:, 1])[0, 1]
    assert correlation > 0.2  # neighbours are drawn jointly


def test_a_map_that_cannot_be_drawn_is_named():
    situation = replace(make_situation(mean=np.zeros(len(POINTS)), sensed=(0,)), draw_map=None)
    assert draws_of(None) is None
    with pytest.raises(PlannerError, match="carry_samples"):
        list(make_planner("thompson-sampling").rank(situation))


# --- cones ---


def test_the_sums_of_every_cone_planner_are_those_of_brute_force():
    rng = np.random.default_rng(3)
    situation = make_situation(
        mean=rng.normal(size=len(POINTS)), variance=rng.uniform(0.1, 3, len(POINTS)), sensed=(7, 210)
    )
    prediction = situation.prediction
    assert prediction is not None
    is_open = ~(seen(situation, 7) | seen(situation, 210))
    weights = {
        "mutual-information": mutual_information(prediction.latent_mean, prediction.latent_variance),
        "expected-volume": prediction.probability * is_open,
        "greedy-coverage": is_open.astype(float),
    }
    for name, of_points in weights.items():
        planner = make_planner(name)
        assert planner.score(situation) == pytest.approx(brute_force(situation, of_points), rel=1e-5)


def test_greedy_coverage_is_greedy_and_keeps_its_promise():
    situation = make_situation()
    sensed, covered = (), np.zeros(len(POINTS), dtype=bool)
    sets = [seen(situation, pose) for pose in range(400)]
    for _ in range(6):
        now = replace(situation, sensed=sensed)
        pose = first("greedy-coverage", now)
        gains = [(~covered & held).sum() for held in sets]
        assert gains[pose] == max(gains)
        sensed, covered = (*sensed, pose), covered | sets[pose]
    two = max((a | b).sum() for a, b in itertools.combinations(sets[::7], 2))
    assert (sets[sensed[0]] | sets[sensed[1]]).sum() >= (1 - 1 / np.e) * two


@pytest.mark.parametrize("name", ["mutual-information", "expected-volume"])
def test_a_belief_that_is_missing_is_named(name):
    with pytest.raises(PlannerError, match="needs the map's prediction"):
        list(make_planner(name).rank(make_situation()))

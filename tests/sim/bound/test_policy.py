"""The bound on every policy against the best adaptive one, found by dynamic programming in tiny worlds."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.bound.places import MOST_FEWEST, Place, fewest_from
from sim.bound.policy import PolicyBound, upper_mean
from sim.bound.policy_study import policy_bound, reason_against
from sim.bound.search import Coverage, coverage_weights
from sim.bound.stage import Stage
from sim.episode.scenario import SCENARIOS
from sim.running.fields import config_of

ALWAYS_ENOUGH = (1,)
"""A hindsight optimum that forbids nothing."""


def place_of(index, met, fewest, x_m=0.0):
    nothing = np.empty(0, dtype=np.float32)
    return Place(
        seed=index, middle_m=np.array([x_m, 0.0, 0.0]), radius_m=0.01, poses=np.asarray(met, dtype=np.int32),
        fewest=np.asarray(fewest, dtype=np.uint8), prices=nothing, worth=0.0,
    )  # fmt: skip


def bound_on(places, n_poses, n_tumours=1):
    coverage = Coverage.of(places, n_poses)
    scenario = replace(SCENARIOS["spheres"], n_tumours=n_tumours)
    weights = list(coverage_weights(coverage))
    return policy_bound(places, weights, lambda i, v: coverage.within[i].T @ v, scenario, ALWAYS_ENOUGH)


def exact_fewest(sees, first, need):
    """The fewest poses, the first among them, that see enough points; by trying all sets."""
    others = [each for each in range(len(sees)) if each != first]
    for n in range(len(sees)):
        for more in itertools.combinations(others, n):
            if sees[[first, *more]].any(axis=0).sum() >= need:
                return n + 1
    return None


def random_world(seed, n_places=6, n_poses=7, n_points=8):
    """Which pose sees which point of the tumour at each place; every tumour can be sensed wholly."""
    rng = np.random.default_rng(seed)
    worlds = []
    for _ in range(n_places):
        sees = rng.random((n_poses, n_points)) < 0.45
        sees[rng.permutation(n_poses)[: n_poses // 2]] = False
        sees[rng.integers(n_poses)] |= ~sees.any(axis=0)
        worlds.append(sees)
    return worlds


def best_mean(met, left):
    """The least mean number of actions of a policy that knows the tumour once a pose meets it.

    Args:
        met: Poses that meet each place.
        left: For each place and pose that meets it, the fewest poses from that one on.
    """
    n_poses = 1 + max(max(each) for each in met)

    @cache
    def total(is_open):
        """The actions of all open places together, from now on."""
        if not is_open:
            return 0.0
        ways = []
        for pose in range(n_poses):
            found = frozenset(each for each in is_open if pose in met[each])
            if found:
                after = sum(left[each][pose] - 1 for each in found)
                ways.append(len(is_open) + after + total(is_open - found))
        return min(ways)

    return total(frozenset(range(len(met)))) / len(met)


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6), need=st.integers(1, 8))
def test_the_best_adaptive_policy_never_beats_the_bound(seed, need):
    worlds = random_world(seed)
    met = [np.flatnonzero(sees.any(axis=1)).tolist() for sees in worlds]
    left = [
        {pose: exact_fewest(sees, pose, need) for pose in each}
        for sees, each in zip(worlds, met, strict=True)
    ]
    places = []
    for index, (sees, each) in enumerate(zip(worlds, met, strict=True)):
        fewest, _, _ = fewest_from(sees[each], need)
        assert (fewest <= [left[index][pose] for pose in each]).all()
        places.append(place_of(index, each, fewest))
    best, bound = best_mean(met, left), bound_on(places, 7)
    assert bound.least_mean(is_apart=True) <= best + 1e-6
    assert bound.least_mean(is_apart=True) >= 0.6 * best


def test_what_is_left_is_told_to_five_where_prices_prove_it():
    # Six cones that share nothing: whoever needs all points needs all of them.
    sees = np.kron(np.eye(6, dtype=bool), np.ones(5, dtype=bool))
    fewest, prices, worth = fewest_from(sees, 30)
    assert fewest.tolist() == [MOST_FEWEST] * 6
    assert len(prices) == 30
    assert worth > 0.0


def test_disjoint_places_are_searched_one_after_the_other():
    places = [place_of(index, [index], [1]) for index in range(10)]
    # A pose finds one of ten places, so the mean of the first hit is that of 1, ..., 10.
    assert bound_on(places, 10).least_mean(is_apart=True) == pytest.approx(5.5, abs=0.05)


def line_world(n, reach):
    """Places on a line, and poses that each meet those near it."""
    return [[pose for pose in range(n) if abs(pose - place) <= reach] for place in range(n)]


def best_pair(met, n, touching):
    """The least mean number of actions until both of two tumours are met, the second drawn apart from the first."""
    law = np.zeros((n, n))
    for first in range(n):
        free = [each for each in range(n) if not touching(first, each)]
        law[first, free] = 1.0 / (n * len(free))

    @cache
    def one(is_open, known):
        """The actions, times the chance, until the other is met too, where one of the two is known."""
        chance = {each: law[known, each] + law[each, known] for each in is_open}
        if not any(chance.values()):
            return 0.0
        ways = []
        for pose in range(n):
            rest = frozenset(each for each in is_open if pose not in met[each])
            if len(rest) < len(is_open):
                ways.append(sum(chance.values()) + one(rest, known))
        return min(ways)

    @cache
    def two(is_open):
        """The same where none is met yet."""
        mass = sum(law[a, b] for a in is_open for b in is_open)
        if not mass:
            return 0.0
        ways = []
        for pose in range(n):
            rest = frozenset(each for each in is_open if pose not in met[each])
            if len(rest) < len(is_open):
                ways.append(mass + two(rest) + sum(one(rest, known) for known in is_open - rest))
        return min(ways)

    return two(frozenset(range(n)))


@pytest.mark.parametrize("reach", [0, 1])
def test_two_tumours_in_independent_places_are_never_met_sooner_than_the_bound_says(reach):
    n = 7
    met = line_world(n, reach)
    places = [place_of(index, each, [1] * len(each), x_m=float(index)) for index, each in enumerate(met)]
    best = best_pair(met, n, lambda a, b: False)
    bound = bound_on(places, n, n_tumours=2)
    assert 0.75 * best <= bound.least_mean(is_apart=False) <= best + 1e-6


@pytest.mark.parametrize("reach", [0, 1])
def test_two_tumours_that_are_kept_apart_are_never_met_sooner_than_the_bound_says(reach):
    n, n_alike = 9, 40
    met = line_world(n, reach)
    # Many of each place, so that the sample's chance to touch is that of the law. Radii of 1 cm and a gap of 2 mm:
    # places at 1.5 cm touch their neighbours.
    places = [
        place_of(index, met[index], [1] * len(met[index]), x_m=0.015 * index)
        for index in range(n)
        for _ in range(n_alike)
    ]
    best = best_pair(met, n, lambda a, b: abs(a - b) <= 1)
    bound = bound_on(places, n, n_tumours=2)
    assert bound.most_weight is not None
    # Of nine places a middle one touches three.
    assert bound.most_weight[0] == pytest.approx(1.0 / (1.0 - 3 / 9), rel=0.01)
    assert 0.5 * best <= bound.least_mean(is_apart=True) <= best + 1e-2
    assert bound.least_mean(is_apart=True) < bound.least_mean(is_apart=False)


def test_a_policy_that_is_done_before_hindsight_allows_it_counts_from_there():
    bound = PolicyBound(
        n_tumours=1, n_places=100, shares=(1.0, 1.0, 1.0, 1.0), weighted=None, most_weight=None, fewest=(2, 4, None),
    )  # fmt: skip
    # Two seeds are done after two and four actions; what can never be done counts up to the last share that is known.
    assert bound.done(is_apart=True).tolist() == pytest.approx([0.0, 0.0, 1 / 3, 1 / 3, 2 / 3])
    assert bound.least_mean(is_apart=True) == pytest.approx(1 + 1 + 2 / 3 + 2 / 3 + 1 / 3)
    assert bound.least_mean(is_apart=True, horizon=2) == pytest.approx(2.0)


def test_the_upper_end_of_a_mean_is_exceeded_as_seldom_as_it_says():
    rng = np.random.default_rng(3)
    for p in (0.02, 0.3, 0.9):
        means = rng.binomial(50, p, 4000) / 50
        too_low = np.mean([upper_mean(float(mean), 50, 1.0, 0.05) < p for mean in means])
        # 4,000 draws tell 5 % to about 1 %; the bound is never loose by more than its own form.
        assert too_low <= 0.06
    assert upper_mean(0.3, 50, 1.0, None) == 0.3
    assert upper_mean(0.0, 50, 2.0, 0.05) == pytest.approx(2.0 * (1.0 - 0.05 ** (1 / 50)))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"scenario": "generated-liver"}, "an organ of its own"),
        ({"scenario": "spheres", "n_tumours": 20}, "need not be sensed at all"),
    ],
)
def test_where_proofs_end_is_said(options, text):
    assert text in reason_against(Stage(config_of(arm="none", **options)), 0)


def test_of_two_balls_in_one_world_much_can_be_proven(small_world):
    assert reason_against(Stage(config_of(scenario=str(small_world), arm="none", n_tumours=2)), 0) is None

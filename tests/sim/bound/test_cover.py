"""The hindsight optimum against all subsets, and what its prices prove."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.bound.check.proof import DoesNotHoldError, proven_value
from sim.bound.cover import cover_bound, dual_value, points_needed


def fewest(sees, need):
    """The fewest poses that see enough points, by trying all sets; None where all poses see too few."""
    for n in range(1, len(sees) + 1):
        if any(
            sees[list(chosen)].any(axis=0).sum() >= need
            for chosen in itertools.combinations(range(len(sees)), n)
        ):
            return n
    return None


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 9), m=st.integers(1, 25), share=st.floats(0.1, 0.6))
def test_the_optimum_lies_between_what_is_proven_and_what_is_chosen(seed, n, m, share):
    rng = np.random.default_rng(seed)
    sees = rng.random((n, m)) < share
    need = int(rng.integers(1, m + 1))
    found, optimum = cover_bound(sees, need), fewest(sees, need)
    if optimum is None:
        assert found is None
        return
    assert found is not None
    # HiGHS closes problems of this size, so what is chosen is the optimum itself.
    assert found.least <= found.solver_least == found.most == optimum
    assert sees[list(found.chosen)].any(axis=0).sum() >= need
    assert proven_value(sees, need, found.prices, found.worth) == pytest.approx(found.value, abs=1e-9)


def test_disjoint_cones_are_proven_to_be_all_needed():
    sees = np.kron(np.eye(6, dtype=bool), np.ones(10, dtype=bool))
    found = cover_bound(sees, 55)
    assert found is not None
    # Five cones hold 50 points; the relaxation needs five and a half.
    assert found.value == pytest.approx(5.5)
    assert found.least == found.most == 6


def test_a_cone_in_which_all_points_lie_is_enough():
    found = cover_bound(np.array([[True] * 20, [True] * 10 + [False] * 10]), 19)
    assert found is not None
    assert (found.least, found.chosen) == (1, (0,))


def test_any_prices_prove_no_more_than_the_optimum():
    rng = np.random.default_rng(5)
    sees = rng.random((8, 30)) < 0.3
    need = 20
    optimum = fewest(sees, need)
    for _ in range(200):
        # Whatever the prices, weak duality holds once no cone is worth more than 1.
        assert dual_value(sees, need, rng.exponential(0.2, 30), rng.exponential(0.3))[0] <= optimum + 1e-9


def test_points_needed_are_those_at_which_an_episode_calls_the_share_reached():
    for n_points in (1, 7, 20, 500, 1500, 1501):
        need = points_needed(n_points, 0.95)
        is_sensed = np.arange(n_points) < need
        assert is_sensed.mean() >= 0.95 > (np.arange(n_points) < need - 1).mean()


@pytest.mark.parametrize(
    ("prices", "worth", "text"),
    [
        (np.full(4, 0.6), 0.6, "worth 1.2"),
        (np.array([0.1, -0.1, 0.1, 0.1]), 0.1, "from 0 on"),
        (np.full(3, 0.1), 0.1, "for each point"),
        (np.full(4, 0.1), np.nan, "worth nan"),
    ],
)
def test_prices_that_are_not_allowed_are_refused(prices, worth, text):
    held = np.array([[True, True, False, False], [False, False, True, True]])
    with pytest.raises(DoesNotHoldError, match=text):
        proven_value(held, 4, prices, worth)

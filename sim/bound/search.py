"""How soon any policy can have found a tumour and sensed it: a bound by linear programs of maximum coverage.

A sequence of poses s_1, s_2, ... can be done with place theta after k actions only where some pose in it meets the
tumour early enough: t - 1 + fewest(theta, s_t) <= k at some t. The share of the places for which that holds is, for the
best sequence of all, at most

    G(k) = max over sequences of the mean over theta of [some t <= k: fewest(theta, s_t) <= k - t + 1].

It is bounded by the dual of its linear relaxation, for any weights w_theta from 0 to 1:

    G(k) <= mean(1 - w) + sum_{t <= k} max_i mean(w_theta [fewest(theta, i) <= k - t + 1]),

since a place counts at most 1 - w for itself and w for each pose that is early enough. The maximum is over all poses,
so the bound holds whatever weights the linear program came to; columns are generated until it is tight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csc_matrix, csr_matrix, hstack, identity, vstack

from .places import MOST_FEWEST, Place

TIGHT = 2e-3
"""A bound is tight enough within this share of the places of what the columns found so far reach."""
MOST_ROUNDS = 12
"""Rounds of columns for one number of actions."""
N_NEW = 40
"""Columns that a round adds for each deadline."""
DONE = 0.9995
"""Share at which later numbers of actions have nothing to add."""
MOST_ACTIONS = 60
"""The largest number of actions looked at."""


@dataclass(frozen=True, eq=False)
class Coverage:
    """Which pose is early enough for which place, by the number of actions left from it on."""

    n_places: int
    within: tuple[csc_matrix, ...]
    """With c + 1 actions left, the pose included: 1 where `fewest` is at most that, shape (n, N) each."""

    @classmethod
    def of(cls, places: Sequence[Place], n_poses: int) -> Coverage:
        """The coverage of places by poses.

        Args:
            places: The places.
            n_poses: Number of poses that are reached.
        """
        ends = np.cumsum([0, *(len(place.poses) for place in places)])
        columns = np.concatenate([place.poses for place in places])
        fewest = np.concatenate([place.fewest for place in places])
        row = np.repeat(np.arange(len(places)), np.diff(ends))
        shape = (len(places), n_poses)
        within = []
        for most in range(1, MOST_FEWEST + 1):
            is_within = fewest <= most
            ones = np.ones(int(is_within.sum()))
            within.append(csc_matrix((ones, (row[is_within], columns[is_within])), shape=shape))
        return cls(len(places), tuple(within))

    def bound(self, n_actions: int, weights: NDArray[np.float64]) -> float:
        """The share of the places that weights prove no sequence to exceed.

        Args:
            n_actions: Number of actions, k.
            weights: From 0 to 1, shape (n,).
        """
        total = float((1.0 - weights).sum())
        for index, n in slots(n_actions):
            total += n * float((self.within[index].T @ weights).max(initial=0.0))
        return total / self.n_places


def slots(n_actions: int) -> list[tuple[int, int]]:
    """The deadlines of a number of actions, as indices of `Coverage.within`, and how many actions each has."""
    last = MOST_FEWEST - 1
    single = [(index, 1) for index in range(min(n_actions, last))]
    return [*single, *([(last, n_actions - last)] if n_actions > last else [])]


def coverage_weights(coverage: Coverage) -> Iterator[NDArray[np.float64]]:
    """Weights for 1, 2, 3, ... actions, shape (n,) each, until all places can be done."""
    columns = [_spread_start(coverage) for _ in coverage.within]
    for n_actions in range(1, MOST_ACTIONS + 1):
        weights = _weights(coverage, n_actions, columns)
        yield weights
        if coverage.bound(n_actions, weights) >= DONE:
            return


def _spread_start(coverage: Coverage) -> list[int]:
    """The poses of the greedy order, with which the columns begin."""
    met, chosen = coverage.within[-1], list[int]()
    is_open = np.ones(coverage.n_places)
    while is_open.any() and len(chosen) < MOST_ACTIONS:
        gain = met.T @ is_open
        best = int(gain.argmax())
        if gain[best] <= 0.0:
            break
        chosen.append(best)
        is_open[met.indices[met.indptr[best] : met.indptr[best + 1]]] = 0.0
    return chosen


def _weights(coverage: Coverage, n_actions: int, columns: list[list[int]]) -> NDArray[np.float64]:
    """The best weights that some rounds of columns find; the columns are extended."""
    best, best_share = np.ones(coverage.n_places), 2.0
    for _ in range(MOST_ROUNDS):
        weights, reached = _solve(coverage, n_actions, columns)
        # The file keeps them in single precision, in which any weights prove something too.
        weights = weights.astype(np.float32).astype(np.float64)
        share = coverage.bound(n_actions, weights)
        if share < best_share:
            best, best_share = weights, share
        if best_share <= reached + TIGHT or not _extend(coverage, n_actions, columns, weights):
            break
    return best


def _solve(coverage: Coverage, n_actions: int, columns: list[list[int]]) -> tuple[NDArray[np.float64], float]:
    """The dual weights of the program over the columns, and the share of the places that it reaches."""
    n, parts = coverage.n_places, slots(n_actions)
    blocks = [coverage.within[index][:, columns[index]] for index, _ in parts]
    counts = [block.shape[1] for block in blocks]
    # Variables: how much of each column, then how much of each place is done, which is to be the largest.
    place_rows = hstack([-hstack(blocks), identity(n)])
    slot_rows = np.zeros((len(parts), sum(counts) + n))
    for row, (start, count) in enumerate(zip(np.cumsum([0, *counts[:-1]]), counts, strict=True)):
        slot_rows[row, start : start + count] = 1.0
    solved = linprog(
        np.concatenate([np.zeros(sum(counts)), -np.ones(n)]),
        A_ub=csr_matrix(vstack([place_rows, csr_matrix(slot_rows)])),
        b_ub=np.concatenate([np.zeros(n), [float(most) for _, most in parts]]),
        bounds=[(0, None)] * sum(counts) + [(0, 1)] * n,
        method="highs",
    )
    if solved.status != 0:
        return np.ones(n), 0.0
    return np.clip(-np.asarray(solved.ineqlin.marginals[:n]), 0.0, 1.0), float(-solved.fun) / n


def _extend(
    coverage: Coverage, n_actions: int, columns: list[list[int]], weights: NDArray[np.float64]
) -> bool:
    """Add the poses that are worth most under the weights and are no columns yet; whether there were any."""
    has_new = False
    for index, _ in slots(n_actions):
        worth = coverage.within[index].T @ weights
        held = set(columns[index])
        least = max((float(worth[each]) for each in held), default=0.0)
        order = np.argsort(-worth, kind="stable")[: 20 * N_NEW]
        new = [int(each) for each in order if worth[each] > least + 1e-9 and int(each) not in held]
        # Neighbours see much the same, so every few of them stand for all.
        columns[index] += new[:: max(1, len(new) // N_NEW)][:N_NEW]
        has_new = has_new or bool(new)
    return has_new

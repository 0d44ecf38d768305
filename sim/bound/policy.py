"""What coverage says about every policy, adaptive and randomised ones included: how soon it can be done at best.

Until a cone meets the tumour, readings do not depend on where it is, so a policy follows a sequence that it may have
drawn by lot; `sim.bound.search` bounds what any sequence has done after k actions, G(k). The number T of actions until
95 % is sensed then has a mean of at least sum_k (1 - G(k)), k from 0 on. With m tumours in independent places all have
to be done, and P(T <= k) <= G(k)^m: let g be the share that a sequence has done so far. An action by which it becomes
g + d finishes each tumour that is open with chance d, those finished change what follows, and by induction

    sum_r binom(m, r) d^r (G - g - d)^(m - r) = (G - g)^m

bounds what can become of m open ones. Where the generator keeps balls of one size apart, it draws each after those
before it from the places that are left, so that the density of m places is at most the independent one over
prod_j (1 - sum_{i < j} b_i), b_i the chance to touch the i-th. That factor is at most a product of f_j(theta_j), each
of which weights the places of one tumour; the same induction then bounds P(T <= k) by the product of the weighted
shares.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.anatomy.tumours import LEAST_GAP_M

from .search import MOST_ACTIONS

CONFIDENCE = 0.95
"""Confidence of the lower ends."""
Worth = Callable[[int, NDArray[np.float64]], NDArray[np.float64]]
"""Given a deadline and a number for each place, the sum for each pose over the places that it is early enough for."""


@dataclass(frozen=True, kw_only=True)
class PolicyBound:
    """How soon any policy can be done."""

    n_tumours: int
    n_places: int
    shares: tuple[float, ...]
    """The most of the places of one tumour that a sequence has done after 1, 2, ... actions; 1 after these."""
    weighted: tuple[tuple[float, ...], ...] | None
    """The same with the places of each tumour weighted for being kept apart; None where that is not known."""
    most_weight: tuple[float, ...] | None
    """The largest weight of a place, for each tumour."""
    fewest: tuple[int | None, ...]
    """The hindsight optimum of each seed; None where no poses are enough."""

    def done(self, *, is_apart: bool, confidence: float | None = None) -> NDArray[np.float64]:
        """The most that P(T <= k) can be after k = 0, 1, 2, ... actions; 1 from there on.

        Args:
            is_apart: Whether it is of tumours as the generator plants them, and not of independent places. Where
                nothing is proven of how it keeps them apart, only the hindsight optimum counts.
            confidence: The confidence with which it is not exceeded; by default the sample's own figure.
        """
        # Half of what may go wrong is the places', half the seeds', each spread over all numbers of actions looked at.
        lapse = None if confidence is None else (1.0 - confidence) / (2 * MOST_ACTIONS)
        rows, most = [self.shares] * self.n_tumours, [1.0] * self.n_tumours
        if is_apart and self.n_tumours > 1:
            rows, most = list(self.weighted or ()), list(self.most_weight or ())
            lapse = None if lapse is None else lapse / self.n_tumours
        in_hindsight = self._in_hindsight(confidence)
        # Beyond the actions that were looked at, the places may all be done.
        product = np.ones(len(in_hindsight))
        for row, largest in zip(rows, most, strict=True):
            product[: len(row)] *= [upper_mean(each, self.n_places, largest, lapse) for each in row]
        return np.concatenate([[0.0], np.minimum(np.minimum(product, 1.0), in_hindsight)])

    def least_mean(
        self, *, is_apart: bool, confidence: float | None = None, horizon: float = math.inf
    ) -> float:
        """The least mean number of actions, where what takes more than the horizon counts with that.

        Args:
            is_apart: See `done`.
            confidence: See `done`.
            horizon: Actions after which an episode is given up.
        """
        done = self.done(is_apart=is_apart, confidence=confidence)
        return float((1.0 - done[: len(done) if math.isinf(horizon) else int(horizon)]).sum())

    def _in_hindsight(self, confidence: float | None) -> NDArray[np.float64]:
        """The share of the truths for which k actions are enough in hindsight, shape (K,).

        It goes on until they are enough for all, or to the last share of the places, whichever is later.
        """
        n = len(self.fewest)
        last = max((each for each in self.fewest if each is not None), default=0)
        n_actions = min(max(last, len(self.shares)), MOST_ACTIONS)
        lapse = None if confidence is None else (1.0 - confidence) / (2 * MOST_ACTIONS)
        done = [
            sum(each is not None and each <= k for each in self.fewest) / n for k in range(1, n_actions + 1)
        ]
        return np.array([upper_mean(each, n, 1.0, lapse) for each in done])


def upper_mean(mean: float, n: int, most: float, lapse: float | None) -> float:
    """The largest mean that a sample's mean leaves likely: Hoeffding's bound in its relative-entropy form.

    P(sample's mean <= x) <= exp(-n KL(x, p)) for values from 0 to 1 of mean p > x. It needs no law of the values.

    Args:
        mean: The sample's mean.
        n: Its size.
        most: The largest value.
        lapse: Chance of being wrong; None for the sample's mean itself.
    """
    share = min(mean / most, 1.0)
    if lapse is None or share >= 1.0:
        return share * most
    room = math.log(1.0 / lapse) / n

    def excess(p: float) -> float:
        low = 0.0 if share == 0.0 else share * math.log(share / p)
        return low + (1.0 - share) * math.log((1.0 - share) / (1.0 - p)) - room

    top = 1.0 - 1e-12
    if excess(top) <= 0.0:
        return most
    low, high = max(share, 1e-12), top
    # The excess rises from below 0 to above it; halving sixty times leaves nothing of the gap.
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if excess(middle) > 0.0 else (middle, high)
    return most * high


def share_done(
    worth: Worth,
    slots: Sequence[tuple[int, int]],
    weights: NDArray[np.float64],
    place_weight: NDArray[np.float64],
) -> float:
    """The share of weighted places that dual weights prove no sequence to exceed, at least 0.

    Args:
        worth: Sums over the places that each pose is early enough for.
        slots: Deadlines, and how many actions each has.
        weights: The dual's, from 0 to 1, shape (n,).
        place_weight: Weight of each place, shape (n,); 1 for an even sample.
    """
    total = float((place_weight * (1.0 - weights)).sum())
    for index, n in slots:
        total += n * float(worth(index, place_weight * weights).max(initial=0.0))
    return total / len(weights)


def apart_weights(
    middles_m: NDArray[np.float64], radii_m: NDArray[np.float64], n_tumours: int
) -> NDArray[np.float64] | None:
    """How much more likely each place is for each of some balls of one size that are kept apart, shape (m, n).

    With b the chance to touch a place, 1 - b_1 - ... - b_r = prod_i (1 - b_i / (1 - b_1 - ... - b_(i - 1))), and each
    sum within is at most (i - 1) times the largest b; the i-th place stands in m - i such products.

    Args:
        middles_m: Middles of the places [m], shape (n, 3).
        radii_m: Their radii [m], shape (n,).
        n_tumours: Number of tumours, m.

    Returns:
        The weights; None where tumours may take up so much room that nothing can be said.
    """
    n = len(middles_m)
    chance = np.zeros(n)
    for index in range(n):
        gap_m = np.linalg.norm(middles_m - middles_m[index], axis=1) - radii_m - radii_m[index]
        chance[index] = (np.count_nonzero(gap_m < LEAST_GAP_M) - 1) / max(n - 1, 1)
    largest = float(chance.max())
    if largest * n_tumours >= 1.0:
        return None
    left = [1.0 - chance / (1.0 - i * largest) for i in range(n_tumours)]
    return np.array([each ** -(n_tumours - 1.0 - i) for i, each in enumerate(left)])

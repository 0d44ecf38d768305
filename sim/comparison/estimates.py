"""Estimates: what a sample of trials says about a mean, a median or a share, with 95 % intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

CONFIDENCE = 0.95
"""Confidence of all intervals."""
N_RESAMPLES = 9999
"""Samples that the bootstrap draws."""
RESAMPLES_AT_ONCE = 1000
"""Samples of clusters that are held in memory at once."""
Interval = tuple[float, float]
NO_INTERVAL = (math.nan, math.nan)


@dataclass(frozen=True, kw_only=True)
class MeanEstimate:
    """A mean with its spread."""

    n: int
    mean: float
    deviation: float
    """Standard deviation of the sample; NaN for fewer than two values."""
    interval: Interval
    """Bootstrap interval of the mean; NaN for fewer than two values."""


@dataclass(frozen=True, kw_only=True)
class PairedEstimate:
    """How one method does against another on the same seeds."""

    n: int
    difference: MeanEstimate
    """First minus second, seed by seed."""
    n_wins: int
    """Seeds on which the first is better."""
    n_ties: int
    win_rate: float
    """Share of seeds won, a tie counting half."""
    win_interval: Interval


@dataclass(frozen=True, kw_only=True)
class ShareEstimate:
    """A share of things that come in clusters, such as the lesions of one organ."""

    n: int
    """Number of things."""
    n_clusters: int
    """Number of clusters that hold any."""
    share: float
    interval: Interval
    """Bootstrap interval over the clusters; NaN for fewer than two."""


def mean_estimate(values: ArrayLike, *, seed: int = 0) -> MeanEstimate:
    """The mean of finite values with its bootstrap interval (bias corrected and accelerated).

    Args:
        values: The sample, shape (n,), n of at least 1.
        seed: Seed of the resampling.

    Raises:
        ValueError: There is no value, or one is not finite.
    """
    sample = np.asarray(values, dtype=np.float64)
    if sample.ndim != 1 or not sample.size or not np.isfinite(sample).all():
        raise ValueError(f"a mean needs a list of finite values, got {sample}")
    deviation = float(sample.std(ddof=1)) if sample.size > 1 else math.nan
    return MeanEstimate(
        n=sample.size, mean=float(sample.mean()), deviation=deviation, interval=_mean_interval(sample, seed)
    )


def shares_by_cluster(
    counts: NDArray[Any], n: ArrayLike, clusters: ArrayLike, *, seed: int = 0
) -> list[ShareEstimate]:
    """The shares of things that come in clusters, with bootstrap intervals that draw whole clusters (percentiles).

    Where the share is 0 or 1, all samples have it too, and a bootstrap says nothing. Wilson's interval takes its place,
    with each cluster for one thing, since it is not known how much the things of a cluster have in common.

    Args:
        counts: How many of each row's things count, by each of K rules, shape (rows, K).
        n: How many things each row has, shape (rows,).
        clusters: The cluster of each row, shape (rows,).
        seed: Seed of the resampling.

    Returns:
        One estimate for each rule, K in all.
    """
    names, of_row = np.unique(np.asarray(clusters), return_inverse=True)
    sums = np.zeros((len(names), np.shape(counts)[1] + 1))
    np.add.at(sums, of_row, np.column_stack([counts, n]).astype(np.float64))
    sums = sums[sums[:, -1] > 0]
    n_clusters, total = len(sums), sums.sum(axis=0)
    shares = total[:-1] / total[-1]
    low, high = _resampled_ends(sums, seed) if n_clusters > 1 else (np.full_like(shares, math.nan),) * 2
    return [
        ShareEstimate(
            n=int(total[-1]),
            n_clusters=n_clusters,
            share=float(share),
            interval=(
                share_interval(float(share), n_clusters)
                if share in (0.0, 1.0) and n_clusters > 1
                else (float(low[i]), float(high[i]))
            ),
        )
        for i, share in enumerate(shares)
    ]


def _resampled_ends(sums: NDArray[np.float64], seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The ends of the bootstrap intervals of shares, shape (K,) each.

    Args:
        sums: What counts in each cluster by each of K rules, and at last how many things there are, (clusters, K + 1).
        seed: Seed of the resampling.
    """
    rng, n = np.random.default_rng(seed), len(sums)
    drawn = np.concatenate(
        [
            rng.multinomial(n, np.full(n, 1.0 / n), size=min(RESAMPLES_AT_ONCE, N_RESAMPLES - first)) @ sums
            for first in range(0, N_RESAMPLES, RESAMPLES_AT_ONCE)
        ]
    )
    shares = drawn[:, :-1] / drawn[:, -1:]
    low, high = np.quantile(shares, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], axis=0)
    return low, high


def median_with_interval(values: ArrayLike) -> tuple[float, Interval]:
    """The median of values, of which some may be infinite, and an interval free of assumptions.

    The interval runs between the order statistics that hold the median with at least 95 % by the binomial
    distribution; five values or fewer have no such interval.

    Args:
        values: The sample, shape (n,), n of at least 1; infinite where an event never came.
    """
    ranked = np.sort(np.asarray(values, dtype=np.float64))
    n = ranked.size
    middle = ranked[[(n - 1) // 2, n // 2]]
    median = float(middle[0]) if middle[0] == middle[1] else float(middle.mean())
    below = int(stats.binom.ppf((1 - CONFIDENCE) / 2, n, 0.5))
    if below < 1:
        return median, NO_INTERVAL
    return median, (float(ranked[below - 1]), float(ranked[n - below]))


def paired_estimate(first: ArrayLike, second: ArrayLike, *, lower_is_better: bool) -> PairedEstimate:
    """How the first of two methods does against the second.

    Args:
        first: Values of the first method, shape (n,), finite.
        second: Values of the second on the same seeds, shape (n,), finite.
        lower_is_better: Whether small values are good.
    """
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if a.shape != b.shape:
        raise ValueError(f"pairs need as many values of both, got {a.shape} and {b.shape}")
    difference = a - b
    better = difference < 0 if lower_is_better else difference > 0
    n_wins, n_ties = int(better.sum()), int((difference == 0).sum())
    win_rate = (n_wins + 0.5 * n_ties) / a.size
    return PairedEstimate(
        n=a.size,
        difference=mean_estimate(difference),
        n_wins=n_wins,
        n_ties=n_ties,
        win_rate=win_rate,
        win_interval=share_interval(win_rate, a.size),
    )


def spread_of(
    curves: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The mean of curves of shares, and the ends of one standard deviation about it, within 0 and 1, each shape (K,).

    Args:
        curves: One curve per trial, shape (n, K).
    """
    mean = curves.mean(axis=0)
    deviation = curves.std(axis=0, ddof=1) if len(curves) > 1 else np.zeros_like(mean)
    return mean, np.clip(mean - deviation, 0, 1), np.clip(mean + deviation, 0, 1)


def reached_shares(needed: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The numbers of actions, from 1 on, at which more trials have got there, and the share that has by then.

    Args:
        needed: Actions that each trial needed, shape (n,); infinite where it never got there.
    """
    ranked = np.sort(needed)
    shares = np.arange(1, len(ranked) + 1) / len(ranked)
    is_there = np.isfinite(ranked)
    return np.concatenate([[1.0], ranked[is_there]]), np.concatenate([[0.0], shares[is_there]])


def share_interval(share: float, n: int) -> Interval:
    """Wilson's interval of a share that was seen among n; it holds at 0 and at 1 too."""
    z = float(stats.norm.ppf((1 + CONFIDENCE) / 2))
    centre = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return max(centre - half, 0.0), min(centre + half, 1.0)


def _mean_interval(sample: NDArray[np.float64], seed: int) -> Interval:
    if sample.size < 2:
        return NO_INTERVAL
    if np.ptp(sample) == 0.0:
        return float(sample[0]), float(sample[0])
    result = stats.bootstrap(
        (sample,),
        np.mean,
        n_resamples=N_RESAMPLES,
        confidence_level=CONFIDENCE,
        method="BCa",
        rng=np.random.default_rng(seed),
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)

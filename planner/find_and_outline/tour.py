"""A tour: the order in which a few stops are visited on the shortest way."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

MAX_STOPS = 12
"""Largest number of stops: more would take too long to order exactly."""


def shortest_tour(first: ArrayLike, between: ArrayLike) -> list[int]:
    """The order of stops with the least total cost, ending anywhere, by dynamic programming (Held and Karp, 1962).

    Args:
        first: Cost of going to each stop from where one is, shape (k,).
        between: Cost of going from stop to stop, shape (k, k).

    Raises:
        ValueError: If there is no stop, or there are more than `MAX_STOPS`.
    """
    start, cost = np.asarray(first, dtype=np.float64), np.asarray(between, dtype=np.float64)
    k = len(start)
    if not 1 <= k <= MAX_STOPS:
        raise ValueError(f"a tour has 1 to {MAX_STOPS} stops, got {k}")
    # The least cost of the ways through a set of stops, a bit mask, that end at one of them.
    best = np.full((1 << k, k), np.inf)
    before = np.zeros((1 << k, k), dtype=np.intp)
    best[1 << np.arange(k), np.arange(k)] = start
    for visited in range(1, 1 << k):
        for last in range(k):
            if not visited >> last & 1 or visited == 1 << last:
                continue
            ways = best[visited ^ 1 << last] + cost[:, last]
            before[visited, last] = np.argmin(ways)
            best[visited, last] = ways[before[visited, last]]
    visited, last = (1 << k) - 1, int(np.argmin(best[-1]))
    order = []
    while visited:
        order.append(last)
        visited, last = visited ^ 1 << last, int(before[visited, last])
    return order[::-1]

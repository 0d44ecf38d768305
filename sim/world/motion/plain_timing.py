"""Timing without toppra: along the path as fast as speeds and half of the accelerations allow.

The acceleration of a joint is q'(s) s̈ + q''(s) ṡ², where s is the place on the path. Each of the two parts is given
half of the limit. This bounds x = ṡ² from above and s̈ on both sides, so that one pass forwards and one backwards over
a grid find the fastest motion within these bounds. It is at most about sqrt(2) times as long as the fastest of all.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from sim.world.ik.chain import Array

LEAST_GRID_INTERVALS, GRID_INTERVALS_PER_KNOT = 200, 8
"""Intervals of a path with a constant acceleration along it."""
TINY = 1e-12
"""Keeps a division by a derivative of zero finite."""


def plain_motion(
    knots: Array, points: Array, speed: Array, acceleration: Array
) -> tuple[Callable[[Array, int], Array], float]:
    """A motion from rest to rest along the cubic spline through points.

    Args:
        knots: Places of the points on the path, increasing from 0, shape (K,).
        points: Coordinates, shape (K, n).
        speed: Limits of their speeds, shape (n,).
        acceleration: Limits of their accelerations, shape (n,).

    Returns:
        The coordinates at some times, or a derivative of order 1 or 2, shape (T, n), and the duration [s].
    """
    path = CubicSpline(knots, points)
    n_intervals = max(LEAST_GRID_INTERVALS, GRID_INTERVALS_PER_KNOT * len(knots))
    s = np.linspace(0.0, knots[-1], n_intervals + 1)
    x, step = _squared_rates(path, s, speed, acceleration), s[1]
    rate = np.sqrt(x)
    time_s = np.concatenate([[0.0], np.cumsum(2.0 * step / (rate[1:] + rate[:-1]))])
    along = np.diff(x) / (2.0 * step)

    def followed(at_s: Array, order: int) -> Array:
        at_s = np.clip(at_s, 0.0, time_s[-1])
        i = np.clip(np.searchsorted(time_s, at_s, side="right") - 1, 0, n_intervals - 1)
        since_s = at_s - time_s[i]
        place = np.minimum(s[i] + rate[i] * since_s + 0.5 * along[i] * since_s**2, knots[-1])
        if order == 0:
            return path(place)
        now = (rate[i] + along[i] * since_s)[:, None]
        if order == 1:
            return path(place, 1) * now
        return path(place, 2) * now**2 + path(place, 1) * along[i][:, None]

    return followed, float(time_s[-1])


def _squared_rates(path: CubicSpline, s: Array, speed: Array, acceleration: Array) -> Array:
    """The largest ṡ² at each place s, shape (N,), zero at both ends."""
    slope, bend = np.abs(path(s, 1)) + TINY, np.abs(path(s, 2)) + TINY
    x = np.minimum((speed / slope) ** 2, 0.5 * acceleration / bend).min(axis=1)
    most = (0.5 * acceleration / slope).min(axis=1)
    gain = 2.0 * (s[1] - s[0]) * np.minimum(most[1:], most[:-1])
    x[0] = x[-1] = 0.0
    for i in range(len(gain)):
        x[i + 1] = min(x[i + 1], x[i] + gain[i])
    for i in reversed(range(len(gain))):
        x[i] = min(x[i], x[i + 1] + gain[i])
    return x

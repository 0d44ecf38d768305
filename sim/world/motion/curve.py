"""Smooth joint curves through the corners of a path."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from sim.world.ik.chain import Array

CORNER_SHARE = 0.45
"""A corner is rounded from this share of the way back to its neighbours."""
CORNER_POINTS = 7
"""Points on a rounded corner."""
SPACING = 0.05
"""Knots of a curve are about this far apart, the largest turn of a joint [rad or m]."""
MIN_KNOTS = 24
"""Knots of a curve at least: enough for the speed of the tip along it."""


def rounded(path: Array) -> Array:
    """A path whose corners are replaced by parabolas, shape (M, n), from one of shape (N, n)."""
    parts = [path[:1]]
    blend = np.linspace(0.0, 1.0, CORNER_POINTS)[:, None]
    for before, corner, after in zip(path[:-2], path[1:-1], path[2:], strict=True):
        enter = corner + CORNER_SHARE * (before - corner)
        leave = corner + CORNER_SHARE * (after - corner)
        parts.append((1 - blend) ** 2 * enter + 2 * blend * (1 - blend) * corner + blend**2 * leave)
    return np.vstack([*parts, path[-1:]])


def through(path: Array) -> CubicSpline:
    """The cubic spline along a path, by its length in the largest turn of a joint; passes through both ends."""
    steps = np.abs(np.diff(path, axis=0)).max(axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    path, along = path[np.r_[True, steps > 1e-9]], along[np.r_[True, steps > 1e-9]]
    n_knots = max(MIN_KNOTS, int(np.ceil(along[-1] / SPACING)))
    knots = np.linspace(0.0, along[-1], n_knots)
    points = np.column_stack([np.interp(knots, along, column) for column in path.T])
    return CubicSpline(knots, points)


def length(path: Array) -> float:
    """Length of a path in the largest turn of a joint [rad or m]."""
    return float(np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0).sum())

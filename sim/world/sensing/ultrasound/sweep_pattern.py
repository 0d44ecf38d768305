"""Where the points of a sweep's reading lie on its planes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .convex_array import ConvexArray

PLASTIC = 1.324717957244746
"""The real root of x^3 = x + 1: shifts by its inverse powers fill a square evenly (Roberts, 2018)."""
NEAR_M = 0.010
"""Just below the tip a plane stands for its own thickness and not for the gap to the next: as much as at this depth."""
N_QUANTILES = 1024
"""Entries of the table of depths."""


def sweep_pattern(
    array: ConvexArray, *, n_planes: int, n_points: int, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Planes, lines and samples of points that fill the volume of a sweep evenly.

    With r the depth below the face and R its radius, a plane is (R + r) dtheta dr in area, and as planes are rocked
    about the tip the gap to the next grows with r. The density over r is therefore (R + r)(r + r0), with r0 for the
    thickness of the plane itself. Point i lies at the share (u + i / p) mod 1 of the lines and at the quantile
    (v + i / p^2) mod 1 of the depths, with p the plastic number.

    Args:
        array: What draws the planes.
        n_planes: Number of planes.
        n_points: Number of points on all of them, of which each gets its share.
        rng: Two draws a plane: u and v.

    Returns:
        Number of the plane, and of the line and the sample on it, which are not whole; shapes (n_points,).
    """
    planes = np.arange(n_points) * n_planes // n_points
    starts = np.searchsorted(planes, np.arange(n_planes))
    within = np.arange(n_points) - starts[planes]
    u, v = rng.uniform(size=(2, n_planes))
    across = (u[planes] + within / PLASTIC) % 1.0
    quantile = (v[planes] + within / PLASTIC**2) % 1.0
    depth_m = np.linspace(0.0, array.depth_m, N_QUANTILES)
    share = np.cumsum((array.radius_m + depth_m) * (depth_m + NEAR_M))
    along_m = np.interp(quantile * share[-1], share, depth_m)
    samples = np.clip(along_m / array.sample_m - 0.5, 0.0, array.n_samples - 1.0)
    return planes, across * (array.n_lines - 1), samples

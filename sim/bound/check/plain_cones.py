"""Cones in plain numpy, for the check alone: written apart from the code that found what is checked."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

SPARE_M = 1e-6
"""Allowance for rounding where cones are left out that lie too far away [m]."""
AT_ONCE = 500_000
"""Pairs of a cone and a point that are looked at together."""


def held_points(
    apex_m: NDArray[np.float64],
    axis: NDArray[np.float64],
    half_angle_rad: float,
    depth_m: float,
    points_m: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Which cone holds which point, shape (N, M): the point's height lies in the cone, and its radius below it.

    Args:
        apex_m: Apexes [m], shape (N, 3).
        axis: Unit vectors from apex to base, shape (N, 3).
        half_angle_rad: Half-angle.
        depth_m: Height of the cones.
        points_m: Points [m], shape (M, 3).
    """
    held = np.zeros((len(apex_m), len(points_m)), dtype=bool)
    # No point of a cone is farther from its apex than its rim is.
    rim_m = depth_m / math.cos(half_angle_rad)
    middle_m = points_m.mean(axis=0)
    around_m = np.linalg.norm(points_m - middle_m, axis=1).max()
    near = np.flatnonzero(np.linalg.norm(apex_m - middle_m, axis=1) <= rim_m + around_m + SPARE_M)
    step = max(1, AT_ONCE // len(points_m))
    for first in range(0, len(near), step):
        part = near[first : first + step]
        offset_m = points_m[None, :, :] - apex_m[part, None, :]
        height_m = np.einsum("nmk,nk->nm", offset_m, axis[part])
        aside_m = offset_m - height_m[:, :, None] * axis[part, None, :]
        radius_m = np.sqrt(np.einsum("nmk,nmk->nm", aside_m, aside_m))
        is_high = (height_m >= 0.0) & (height_m <= depth_m)
        held[part] = is_high & (radius_m <= height_m * math.tan(half_angle_rad))
    return held


def gap_to_cones_m(
    apex_m: NDArray[np.float64],
    axis: NDArray[np.float64],
    half_angle_rad: float,
    depth_m: float,
    point_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """How far a point is from each cone [m], 0 inside, shape (N,): to the triangle that the cone is beside its axis.

    Args:
        apex_m: Apexes [m], shape (N, 3).
        axis: Unit vectors from apex to base, shape (N, 3).
        half_angle_rad: Half-angle.
        depth_m: Height of the cones.
        point_m: The point [m], shape (3,).
    """
    offset_m = point_m - apex_m
    height_m = np.einsum("nk,nk->n", offset_m, axis)
    radius_m = np.linalg.norm(offset_m - height_m[:, None] * axis, axis=1)
    place_m = np.column_stack([radius_m, height_m])
    rim_m = np.array([depth_m * math.tan(half_angle_rad), depth_m])
    to_mantle_m = _gap_to_segment_m(place_m, np.zeros(2), rim_m)
    to_base_m = _gap_to_segment_m(place_m, np.array([0.0, depth_m]), rim_m)
    is_high = (height_m >= 0.0) & (height_m <= depth_m)
    is_inside = is_high & (radius_m <= height_m * math.tan(half_angle_rad))
    return np.where(is_inside, 0.0, np.minimum(to_mantle_m, to_base_m))


def _gap_to_segment_m(
    place_m: NDArray[np.float64], start_m: NDArray[np.float64], end_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How far points of a plane are from a segment [m], shape (N,)."""
    along = (place_m - start_m) @ (end_m - start_m) / float((end_m - start_m) @ (end_m - start_m))
    nearest_m = start_m + np.clip(along, 0.0, 1.0)[:, None] * (end_m - start_m)
    return np.linalg.norm(place_m - nearest_m, axis=1)

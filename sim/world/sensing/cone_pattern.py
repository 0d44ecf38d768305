"""The sampling of the cone: where in the sensed volume a reading has its points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner import Cone

GOLDEN_ANGLE_RAD = np.pi * (3.0 - np.sqrt(5.0))
"""Turn from one ray of a sunflower pattern to the next."""
DEPTH_SHIFT = np.sqrt(3.0) - 1.0
"""Shift of the points along one ray against those of the ray before, as a share of the gap between them;
`cone_pattern` says why it is no multiple of the golden ratio."""


def cone_pattern(
    cone: Cone, *, n_rays: int, n_points_per_ray: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rays from the apex of a cone and places along them that fill its volume evenly.

    With R rays i = 0, ..., R - 1 of K points k = 0, ..., K - 1 each, and u, v drawn evenly from [0, 1):

        angle about the axis    phi_i = g i + 2 pi u                    g = pi (3 - sqrt 5), the golden angle
        slope off the axis      t_i = tan(half angle) sqrt((i + 1/2) / R)
        depth along the axis    z_ik = depth cbrt((k + f_i) / K)        f_i = (s i + v) mod 1, s = sqrt 3 - 1
        point                   z_ik (t_i cos phi_i, t_i sin phi_i, 1)

    The rays pierce the base in a sunflower pattern, evenly in area. The part of the cone above a depth z has the share
    (z / depth)^3 of its volume, so the cube root makes the depths even in volume: of K parts of equal volume, each
    holds one point of every ray.

    The shift s staggers the points of neighbouring rays. From ray to ray the pattern turns by 2 - G whole turns, with
    the golden ratio G = (1 + sqrt 5) / 2. Were s a multiple of G too, up to whole numbers, the depth of a point would
    follow from its angle about the axis: all points would lie on one sheet that winds about the axis, and between its
    windings there would be gaps.

    Args:
        cone: The volume to fill.
        n_rays: Number of rays, R.
        n_points_per_ray: Number of points on each ray, K.
        rng: Two draws: u turns the pattern about the axis, v shifts the points along the rays.

    Returns:
        Unit directions in the probe's frame, shape (R, 3), and ranges along them from the apex [m], shape (R, K).
    """
    i = np.arange(n_rays)
    turn_rad = GOLDEN_ANGLE_RAD * i + rng.uniform(0.0, 2.0 * np.pi)
    slope = np.tan(cone.half_angle_rad) * np.sqrt((i + 0.5) / n_rays)
    offset = (i * DEPTH_SHIFT + rng.uniform()) % 1.0
    volume_share = (np.arange(n_points_per_ray) + offset[:, None]) / n_points_per_ray
    depth_m = cone.depth_m * np.cbrt(volume_share)
    directions = np.column_stack([slope * np.cos(turn_rad), slope * np.sin(turn_rad), np.ones(n_rays)])
    length = np.linalg.norm(directions, axis=1)
    return directions / length[:, None], depth_m * length[:, None]

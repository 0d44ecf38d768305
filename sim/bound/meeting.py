"""Which cones may meet a tumour: none that is left out holds any point of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planner import Cone
from sim.world.solids.solid import Solid

SPARE_M = 1e-6
"""Allowance for MuJoCo's meshes, which are kept in single precision [m]."""


def meets(
    cone: Cone, apex_m: NDArray[np.float64], axis: NDArray[np.float64], tumour: Solid
) -> NDArray[np.bool_]:
    """Which of some cones may meet a tumour, shape (N,).

    A cone that meets it comes as near to the middle of its vertices as the farthest vertex does. Where the surface is
    far from a ball, it also comes near to some vertex: the cone begins outside, so it holds a point of the surface, and
    no point of a triangle is farther from the nearest corner than its longest edge over the root of 3.

    Args:
        cone: The shape of all cones.
        apex_m: Their apexes [m], shape (N, 3).
        axis: Unit vectors along them, shape (N, 3).
        tumour: The tumour's surface.
    """
    vertices_m = tumour.vertices_m
    middle_m = vertices_m.mean(axis=0)
    radii_m = np.linalg.norm(vertices_m - middle_m, axis=1)
    may = distance_m(cone, apex_m, axis, middle_m) <= radii_m.max() + SPARE_M
    corners_m = vertices_m[tumour.faces]
    edge_m = float(np.linalg.norm(corners_m - np.roll(corners_m, 1, axis=1), axis=2).max())
    near_m = edge_m / math.sqrt(3.0)
    if radii_m.max() - radii_m.min() <= near_m:
        return may
    for pose in np.flatnonzero(may):
        may[pose] = distance_m(cone, apex_m[pose], axis[pose], vertices_m).min() <= near_m + SPARE_M
    return may


def distance_m(
    cone: Cone, apex_m: NDArray[np.float64], axis: NDArray[np.float64], points_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The distance from points to solid cones, 0 inside [m]; the arguments broadcast as in `Cone.contains`.

    In the half-plane through the axis and the point the cone is a triangle, of which two sides face outwards: the
    mantle, from the apex along the half-angle, and the base.

    Args:
        cone: The shape of all cones.
        apex_m: Apexes [m], shape (3,) or (N, 3).
        axis: Unit vectors along them, shape (3,) or (N, 3).
        points_m: Points [m], shape (3,) or (N, 3).
    """
    offset_m = points_m - apex_m
    height_m = (offset_m * axis).sum(axis=-1)
    radius_m = np.sqrt(np.maximum((offset_m**2).sum(axis=-1) - height_m**2, 0.0))
    sin, cos = math.sin(cone.half_angle_rad), math.cos(cone.half_angle_rad)
    along_m = np.clip(height_m * cos + radius_m * sin, 0.0, cone.depth_m / cos)
    to_mantle_m = np.hypot(height_m - along_m * cos, radius_m - along_m * sin)
    to_base_m = np.hypot(height_m - cone.depth_m, np.maximum(radius_m - cone.base_radius_m, 0.0))
    is_inside = (height_m >= 0.0) & (height_m <= cone.depth_m) & (radius_m * cos <= height_m * sin)
    return np.where(is_inside, 0.0, np.minimum(to_mantle_m, to_base_m))

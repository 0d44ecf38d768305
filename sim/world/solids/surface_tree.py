"""How near triangles come to a solid, exactly: they are held against its distance grid and halved until it is decided.

A distance changes by no more than the way gone, so a ball of triangles whose centre is d from the solid has no point
nearer than d less the ball's radius. Balls that hold more and more of the triangles form a tree; only those that may
hold the nearest point are opened, down to triangles, and these are halved on. Nothing between samples is missed.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .distance_grid import DistanceGrid
from .surface_distance import halve_triangles

Array = NDArray[np.float64]

TOLERANCE_M = 5e-4
"""Triangles are halved until none of their points is farther than this from their centroid [m] ..."""
TOLERANCE_SHARE = 0.05
"""... or than this share of their distance, where that is more."""
FIRST_EDGE_M = 0.03
"""Triangles of the tree have no edge longer than this [m], so that its balls are round."""
LEVELS_AT_ONCE = 2
"""A ball is opened by so many halvings at a time: fewer, larger array operations."""
PLACES_AT_ONCE = 128
"""Places that are looked at together, for the sake of memory: a flat face on a flat one opens thousands of balls."""


class SurfaceTree:
    """Triangles in a tree of balls.

    Args:
        corners_m: The triangles' corners in a frame of their own [m], shape (N, 3 corners, 3), N at least 1.
    """

    def __init__(self, corners_m: Array) -> None:
        """Keep the triangles; the tree is made when it is first needed."""
        self._given_m = corners_m
        points_m = corners_m.reshape(-1, 3)
        self.reach_m = float(np.linalg.norm(points_m, axis=1).max())
        """How far the triangles reach from their frame's origin [m]."""
        self._middle_m = (points_m.min(axis=0) + points_m.max(axis=0)) / 2.0
        self._radius_m = float(np.linalg.norm(points_m - self._middle_m, axis=1).max())

    @cached_property
    def corners_m(self) -> Array:
        """The triangles with short edges, in the order of the tree's leaves [m], shape (2^k, 3 corners, 3)."""
        return _in_order(_with_short_edges(self._given_m))

    @cached_property
    def _balls(self) -> list[tuple[Array, Array]]:
        """Centres (n, 3) and radii (n,) of the balls [m], from the one that holds all to one a triangle."""
        n_levels = len(self.corners_m).bit_length() - 1
        levels = [*range(0, n_levels, LEVELS_AT_ONCE), n_levels]
        balls = []
        for level in levels:
            points_m = self.corners_m.reshape(2**level, -1, 3)
            centres_m = (points_m.min(axis=1) + points_m.max(axis=1)) / 2.0
            balls.append((centres_m, np.linalg.norm(points_m - centres_m[:, None], axis=2).max(axis=1)))
        return balls

    def distances_m(
        self, grid: DistanceGrid, at_m: Array, R_world: Array, far_m: Array | float = np.inf
    ) -> Array:
        """Signed distance of the triangles to a solid in many places, negative where they enter it.

        Args:
            grid: The solid's distance grid.
            at_m: Where the triangles' frame stands [m], shape (N, 3).
            R_world: How it is turned, shape (N, 3, 3).
            far_m: Nothing beyond this [m] is told apart, shape (N,) or one for all.

        Returns:
            Shape (N,): never more than the distance of the nearest point by the grid, and less by at most
            `TOLERANCE_M` or the share `TOLERANCE_SHARE`; beyond `far_m` any value of at least that.
        """
        far_m = np.broadcast_to(far_m, len(at_m))
        least_m = grid.distance_m(at_m + R_world @ self._middle_m) - self._radius_m
        near = np.flatnonzero(least_m < far_m)
        for first in range(0, len(near), PLACES_AT_ONCE):
            rows = near[first : first + PLACES_AT_ONCE]
            descent = _Descent(grid, at_m[rows], R_world[rows], far_m[rows])
            least_m[rows] = descent.run(self._balls, self.corners_m)
        return least_m


class _Descent:
    """The search for the nearest point of the triangles in some places at once."""

    def __init__(self, grid: DistanceGrid, at_m: Array, R_world: Array, far_m: Array) -> None:
        self._grid, self._at_m, self._R_world = grid, at_m, R_world
        # What counts is the least so far, and what was not opened is no nearer than that.
        self._least_m = far_m.copy()
        self._most_m = far_m.copy()

    def run(self, balls: list[tuple[Array, Array]], corners_m: Array) -> Array:
        """The distances: down the tree, then on by halving the triangles that are left."""
        rows, index = np.arange(len(self._at_m)), np.zeros(len(self._at_m), dtype=np.int64)
        for level, (centres_m, radii_m) in enumerate(balls):
            if level:
                n_each = len(centres_m) // len(balls[level - 1][0])
                rows = np.repeat(rows, n_each)
                index = (index[:, None] * n_each + np.arange(n_each)).ravel()
            is_open = self._look(rows, centres_m[index], radii_m[index])
            rows, index = rows[is_open], index[is_open]
        triangles_m = corners_m[index]
        while len(rows):
            triangles_m, rows = halve_triangles(triangles_m), np.tile(rows, 2)
            centres_m = triangles_m.mean(axis=1)
            is_open = self._look(rows, centres_m, _radii_m(triangles_m, centres_m))
            triangles_m, rows = triangles_m[is_open], rows[is_open]
        return self._least_m

    def _look(self, rows: NDArray[np.int64], centres_m: Array, radii_m: Array) -> NDArray[np.bool_]:
        """Which balls have to be opened; those that are small enough to count are taken in."""
        world_m = self._at_m[rows] + np.einsum("nij,nj->ni", self._R_world[rows], centres_m)
        distance_m = self._grid.distance_m(world_m)
        # Each ball holds a point of the triangles.
        np.minimum.at(self._most_m, rows, distance_m + radii_m)
        bound_m = distance_m - radii_m
        may_be_nearest = bound_m <= np.minimum(self._most_m, self._least_m)[rows]
        is_small = radii_m <= np.maximum(TOLERANCE_M, TOLERANCE_SHARE * distance_m)
        counts = may_be_nearest & is_small
        np.minimum.at(self._least_m, rows[counts], bound_m[counts])
        return may_be_nearest & ~is_small


def _radii_m(corners_m: Array, centres_m: Array) -> Array:
    return np.linalg.norm(corners_m - centres_m[:, None], axis=2).max(axis=1)


def _with_short_edges(corners_m: Array) -> Array:
    """Triangles halved until no edge is longer than `FIRST_EDGE_M`."""
    done = []
    while len(corners_m):
        longest_m = np.linalg.norm(np.roll(corners_m, -1, axis=1) - corners_m, axis=2).max(axis=1)
        done.append(corners_m[longest_m <= FIRST_EDGE_M])
        corners_m = halve_triangles(corners_m[longest_m > FIRST_EDGE_M])
    return np.concatenate(done)


def _in_order(corners_m: Array) -> Array:
    """The triangles as leaves of a balanced tree: halved at the middle of the longest side, again and again.

    Some stand twice, so that there are 2^k of them.
    """
    n_levels = int(np.ceil(np.log2(len(corners_m)))) if len(corners_m) > 1 else 0
    order = np.linspace(0, len(corners_m) - 1, 2**n_levels).round().astype(np.int64)
    centres_m = corners_m.mean(axis=1)
    for level in range(n_levels):
        parts = order.reshape(2**level, -1)
        at_m = centres_m[parts]
        axis = np.ptp(at_m, axis=1).argmax(axis=1)
        along_m = np.take_along_axis(at_m, axis[:, None, None], axis=2)[..., 0]
        order = np.take_along_axis(parts, np.argsort(along_m, axis=1, kind="stable"), axis=1).ravel()
    return corners_m[order]

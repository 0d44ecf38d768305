"""Distance from points to a triangle surface, signed by which side they are on.

A KD-tree over points strewn on the surface, vertices included, names the triangles near a query; the distance
to these is exact (closest point of a triangle: Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
Far from the surface the distance to the nearest strewn point is already within r^2 / (2 d) of the truth, r
being how far a surface point can be from the nearest strewn one.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from .solid import Solid, check_points

SAMPLE_SPACING_M = 0.002
"""Triangles are divided until no piece has an edge longer than this [m], so r is at most 1.2 mm."""

EXACT_BAND_M = 0.010
"""Closer than this [m] the distance is taken to the triangles; beyond it r^2 / (2 d) is below 0.07 mm."""

N_NEAR_SAMPLES = 6
"""Strewn points looked up per query in the band: their triangles include the closest or a neighbour of it."""


class SurfaceDistance:
    """Signed distance to the surface of a solid, exact near it.

    Args:
        solid: The solid whose surface is meant.
    """

    def __init__(self, solid: Solid) -> None:
        """Strews the points and builds their tree."""
        self._solid = solid
        samples_m, self._sample_face = strew_points(solid, SAMPLE_SPACING_M)
        # Neither balanced nor compact: queries far from the surface, where most of a lattice lies, run 2-4x
        # faster.
        self._tree = KDTree(samples_m, balanced_tree=False, compact_nodes=False)
        self._corners_m = solid.vertices_m[solid.faces]

    def distance_to_triangles_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance [m] to the triangles of the nearest strewn points, shape (N,): exact near the surface."""
        n_near = min(N_NEAR_SAMPLES, self._tree.n)
        faces = self._sample_face[self._tree.query(points_m, k=n_near)[1].reshape(-1, n_near)]
        repeated = np.repeat(points_m, n_near, axis=0)
        closest = closest_points_on_triangles(repeated, self._corners_m[faces.ravel()])
        return np.linalg.norm(repeated - closest, axis=1).reshape(faces.shape).min(axis=1)

    def distance_m(self, points_m: ArrayLike) -> NDArray[np.float64]:
        """Distance [m] of each point to the surface, within 0.1 mm and never below zero.

        Args:
            points_m: Query points [m], shape (N, 3).

        Returns:
            Shape (N,).
        """
        points = check_points(points_m)
        distance = np.asarray(self._tree.query(points)[0], dtype=np.float64)
        near = np.flatnonzero(distance < EXACT_BAND_M)
        distance[near] = self.distance_to_triangles_m(points[near])
        return distance

    def signed_distance_m(self, points_m: ArrayLike) -> NDArray[np.float64]:
        """Distance [m] of each point to the surface, negative inside the solid.

        Args:
            points_m: Query points [m], shape (N, 3).

        Returns:
            Shape (N,).
        """
        points = check_points(points_m)
        distance = self.distance_m(points)
        return np.where(self._solid.contains(points), -distance, distance)


def strew_points(solid: Solid, spacing_m: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points on every triangle, its corners included, such that no surface point is far from one.

    Triangles are halved across their longest edge until all edges are short, so slivers cost no more than
    their area.

    Args:
        solid: The solid whose surface is meant.
        spacing_m: Longest edge of the pieces whose corners are the points [m].

    Returns:
        Points [m], shape (P, 3), and a triangle that each lies on, shape (P,).
    """
    vertices, first_use = np.unique(solid.faces, return_index=True)
    points, owners = [solid.vertices_m[vertices]], [first_use // 3]
    corners, owner = solid.vertices_m[solid.faces], np.arange(len(solid.faces))
    while len(corners):
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        is_long = lengths.max(axis=1) > spacing_m
        corners, owner, longest = corners[is_long], owner[is_long], lengths[is_long].argmax(axis=1)
        a, b, c = (
            np.take_along_axis(corners, ((longest + k) % 3)[:, None, None], axis=1)[:, 0] for k in range(3)
        )
        middle = 0.5 * (a + b)
        points.append(middle)
        owners.append(owner)
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        owner = np.concatenate([owner, owner])
    return np.concatenate(points), np.concatenate(owners)


def closest_points_on_triangles(
    points: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Closest point of one triangle to one point, for many pairs.

    Args:
        points: Query points, shape (N, 3).
        corners: The triangles' corners in the same unit, shape (N, 3 corners, 3).

    Returns:
        Shape (N, 3).
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    on_edges = np.stack([_closest_on_segment(points, p, q) for p, q in ((a, b), (b, c), (c, a))])
    squared = np.square(on_edges - points).sum(axis=2)
    best = np.take_along_axis(on_edges, squared.argmin(axis=0)[None, :, None], axis=0)[0]
    normal = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", normal, normal)
    height = np.divide(
        np.einsum("ij,ij->i", points - a, normal), area, out=np.zeros_like(area), where=area > 0
    )
    foot = points - height[:, None] * normal
    is_over_face = area > 0
    for p, q in ((a, b), (b, c), (c, a)):
        is_over_face &= np.einsum("ij,ij->i", np.cross(q - p, foot - p), normal) >= 0
    return np.where(is_over_face[:, None], foot, best)


def _closest_on_segment(
    points: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    along = end - start
    squared = np.einsum("ij,ij->i", along, along)
    t = np.einsum("ij,ij->i", points - start, along)
    t = np.clip(np.divide(t, squared, out=np.zeros_like(t), where=squared > 0), 0.0, 1.0)
    return start + t[:, None] * along

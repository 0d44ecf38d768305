"""Distance from points to a triangle surface, signed by which side they are on.

Near the surface, a KD-tree over small pieces of the triangles names those that a query may be closest to; the
distance to these is exact (closest point of a triangle: Ericson, Real-Time Collision Detection, 2005, section
5.1.5). Far from it, the distance to the nearest of many points strewn on the surface, vertices included, is
within r^2 / (2 d) of the truth, r being how far a surface point can be from the nearest strewn one.
"""

from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from .solid import Solid, check_points

ON_SURFACE_M = 1e-9
"""Closer than this [m] the direction from the closest point means nothing, and the triangle's normal is taken."""

SAMPLE_SPACING_M = 0.002
"""Triangles are divided until no piece has an edge longer than this [m], so r is at most 1.2 mm."""

EXACT_BAND_M = 0.010
"""Closer than this [m] the distance is taken to the triangles; beyond it r^2 / (2 d) is below 0.07 mm."""

NARROW_SHARE = 0.85
"""A triangle is narrow whose shortest edge is below this share of the spacing: strips half as long then fit."""

N_NEAR_PIECES = 6
"""Pieces looked up per query in the band: the closest triangle, or one hardly farther, is among theirs."""


class SurfaceDistance:
    """Signed distance to the surface of a solid, exact near it.

    Args:
        solid: The solid whose surface is meant.
    """

    def __init__(self, solid: Solid) -> None:
        """Divides the triangles into pieces and builds a tree over these."""
        self._solid = solid
        self._corners_m = solid.vertices_m[solid.faces]
        pieces, self._piece_face = divide_triangles(solid, SAMPLE_SPACING_M)
        self._pieces = KDTree(pieces.mean(axis=1))

    @cached_property
    def _points(self) -> KDTree:
        return strewn_tree(self._solid, SAMPLE_SPACING_M)

    def distance_to_triangles_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance [m] to the triangles of the nearest pieces, shape (N,): exact near the surface."""
        n_near = min(N_NEAR_PIECES, self._pieces.n)
        faces = self._piece_face[self._pieces.query(points_m, k=n_near)[1].reshape(-1, n_near)]
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
        distance = np.asarray(self._points.query(points)[0], dtype=np.float64)
        near = np.flatnonzero(distance < EXACT_BAND_M)
        distance[near] = self.distance_to_triangles_m(points[near])
        return distance

    def signed_distance_and_outward(
        self, points_m: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distance [m] of each point to the triangles, negative inside, and the direction in which it grows.

        Args:
            points_m: Query points [m], shape (N, 3); exact for those near the surface.

        Returns:
            Shape (N,), and unit vectors of shape (N, 3): on the surface itself they are the triangles' normals.
        """
        points = check_points(points_m)
        n_near = min(N_NEAR_PIECES, self._pieces.n)
        faces = self._piece_face[self._pieces.query(points, k=n_near)[1].reshape(-1, n_near)]
        repeated = np.repeat(points, n_near, axis=0)
        closest = closest_points_on_triangles(repeated, self._corners_m[faces.ravel()])
        away = (repeated - closest).reshape(*faces.shape, 3)
        distance = np.linalg.norm(away, axis=2)
        rows, best = np.arange(len(points)), distance.argmin(axis=1)
        distance, away, faces = distance[rows, best], away[rows, best], faces[rows, best]
        a, b, c = self._corners_m[faces].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        outward = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        sign = np.where(self._solid.contains(points), -1.0, 1.0)
        is_off = distance > ON_SURFACE_M
        outward[is_off] = (sign / np.maximum(distance, ON_SURFACE_M))[is_off, None] * away[is_off]
        return sign * distance, outward

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


@lru_cache(maxsize=2)
def surface_distance_of(solid: Solid) -> SurfaceDistance:
    """The distance to a solid's surface, kept for the next call with the same solid."""
    return SurfaceDistance(solid)


def strew_points(solid: Solid, spacing_m: float) -> NDArray[np.float64]:
    """Points on the surface, all vertices among them, such that no surface point is far from one.

    Args:
        solid: The solid whose surface is meant.
        spacing_m: Longest edge of the pieces whose corners are the points [m].

    Returns:
        Points [m], shape (P, 3): no surface point is farther than spacing_m / sqrt(3) from one.
    """
    corners = divide_triangles(solid, spacing_m)[0].reshape(-1, 3)
    # Equal points have equal products, which sort faster than points.
    product = corners @ np.sqrt([2.0, 3.0, 5.0])
    return corners[np.unique(product, return_index=True)[1]]


def strewn_tree(solid: Solid, spacing_m: float) -> KDTree:
    """A tree of the points strewn on a surface, made for queries from afar.

    It is neither balanced nor compact: there, where most nodes of a lattice lie, it then answers 2-4x faster.
    """
    return KDTree(strew_points(solid, spacing_m), balanced_tree=False, compact_nodes=False)


def divide_triangles(solid: Solid, spacing_m: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The surface in pieces with short edges.

    Triangles are halved across their longest edge until all edges are short, and narrow ones cut into strips
    across their length, which halving would shatter: a sliver makes no more pieces than its length needs.

    Args:
        solid: The solid whose surface is meant.
        spacing_m: Longest edge allowed [m].

    Returns:
        Corners of the pieces [m], shape (P, 3 corners, 3), and the triangle each is part of, shape (P,).
    """
    pieces, owners = [], []
    corners, owner = solid.vertices_m[solid.faces], np.arange(len(solid.faces))
    while len(corners):
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        is_long = lengths.max(axis=1) > spacing_m
        is_narrow = (lengths.min(axis=1) < NARROW_SHARE * spacing_m) & (lengths.max(axis=1) > 2.0 * spacing_m)
        pieces.append(corners[~is_long])
        owners.append(owner[~is_long])
        is_wide = is_long & ~is_narrow
        strips, of_strip = _cut_in_strips(corners[is_narrow], lengths[is_narrow], 0.5 * spacing_m)
        corners = np.concatenate([halve_triangles(corners[is_wide]), strips])
        owner = np.concatenate([owner[is_wide], owner[is_wide], owner[is_narrow][of_strip]])
    return np.concatenate(pieces), np.concatenate(owners)


def halve_triangles(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Triangles cut across their longest edge: the first halves, then the second, shape (2 N, 3 corners, 3)."""
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    a, b, c = _corners_from(corners, lengths.argmax(axis=1))
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _cut_in_strips(
    corners: NDArray[np.float64], lengths: NDArray[np.float64], width_m: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Triangles cut parallel to their shortest edge into strips of two triangles.

    Returns:
        Corners of the parts [m], shape (P, 3 corners, 3), and which of the triangles each is part of.
    """
    n_strips = np.ceil(lengths.max(axis=1) / width_m).astype(np.int64)
    of_strip = np.repeat(np.arange(len(corners)), n_strips)
    number = np.arange(len(of_strip)) - np.repeat(np.cumsum(n_strips) - n_strips, n_strips)
    q, r, apex = (corner[of_strip] for corner in _corners_from(corners, lengths.argmin(axis=1)))
    near, far = ((number + k)[:, None] / n_strips[of_strip][:, None] for k in (0, 1))
    q_near, q_far, r_near, r_far = (
        apex + share * (end - apex) for end, share in ((q, near), (q, far), (r, near), (r, far))
    )
    # The strip at the apex is a triangle, not two.
    at_apex = number == 0
    parts = np.stack([q_near, q_far, r_far], axis=1), np.stack([q_near, r_far, r_near], axis=1)[~at_apex]
    return np.concatenate(parts), np.concatenate([of_strip, of_strip[~at_apex]])


def _corners_from(
    corners: NDArray[np.float64], edge: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Both ends of an edge of each triangle, and the corner opposite; edge k runs from corner k to the next."""
    a, b, c = (np.take_along_axis(corners, ((edge + k) % 3)[:, None, None], axis=1)[:, 0] for k in range(3))
    return a, b, c


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
    """The closest point of one segment to one point, for many pairs, shape (N, 3)."""
    along = end - start
    squared = np.einsum("ij,ij->i", along, along)
    t = np.einsum("ij,ij->i", points - start, along)
    t = np.clip(np.divide(t, squared, out=np.zeros_like(t), where=squared > 0), 0.0, 1.0)
    return start + t[:, None] * along

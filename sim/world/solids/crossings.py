"""Where vertical rays cross a triangle surface, for many rays at once and with nothing but NumPy.

Triangles are binned on a grid in the xy plane; a point's ray can only meet the triangles of its own bin.
Whether a place lies within a triangle is decided by which side of each edge it is on. Every edge is evaluated
from its lower to its higher vertex index, so both triangles that share it see the same rounding, and a ray
through the edge is counted by exactly one of them. Places are moved by a fixed irrational fraction of a
nanometre, so that lattice points do not fall on vertices and edges of meshes drawn on the same lattice.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SHIFT_M = 1e-9 * np.array([np.sqrt(2.0) - 1.0, np.sqrt(3.0) - 1.0])
"""Move of the rays in the plane [m]: far below any tolerance, and on no lattice."""

CHUNK_PAIRS = 400_000
"""Point-triangle pairs tested at once: about 60 MB of temporaries."""

TRIANGLES_PER_BIN = 2.0
"""Mean number of triangles in a bin that is aimed at; fewer cost memory, more cost tests."""


@dataclass(frozen=True, eq=False)
class _Hits:
    """Crossings above points: which point, +1 or -1 for the way through the surface, and where."""

    point: NDArray[np.int64]
    sign: NDArray[np.int64]
    height_m: NDArray[np.float64]


class VerticalCrossings:
    """The crossings of rays towards +z with a fixed triangle surface.

    Args:
        vertices_m: Vertices [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
    """

    def __init__(self, vertices_m: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
        """Bins the triangles."""
        corners = vertices_m[faces]
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        normals = np.cross(b - a, c - a)
        # A vertical ray never crosses a vertical triangle.
        is_flat_enough = normals[:, 2] != 0.0
        faces, corners, normals = faces[is_flat_enough], corners[is_flat_enough], normals[is_flat_enough]
        self._sign = np.sign(normals[:, 2]).astype(np.int64)
        self._slope = -normals[:, :2] / normals[:, 2:]
        self._origin_m = corners[:, 0]
        self._lines, self._is_left = _edge_lines(vertices_m, faces, self._sign)
        self._bin(corners)

    def _bin(self, corners: NDArray[np.float64]) -> None:
        """Lists the triangles that may lie over each bin of a grid in the plane."""
        low, high = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
        self._low = low.min(axis=0, initial=np.inf) if len(low) else np.zeros(2)
        span = (high.max(axis=0) - self._low) if len(high) else np.ones(2)
        n_bins = max(len(corners) / TRIANGLES_PER_BIN, 1.0)
        size = np.sqrt(max(np.prod(span), 1e-18) / n_bins)
        self._shape = np.clip(np.ceil(span / size), 1, 2000).astype(np.int64)
        self._bin_size = np.maximum(span, 1e-12) / self._shape
        first, last = self._bin_of(low), self._bin_of(high)
        width = last - first + 1
        count = width[:, 0] * width[:, 1]
        triangle = np.repeat(np.arange(len(corners)), count)
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        i = first[triangle, 0] + within // width[triangle, 1]
        j = first[triangle, 1] + within % width[triangle, 1]
        key = i * self._shape[1] + j
        order = np.argsort(key)
        self._triangles = triangle[order]
        self._start = np.searchsorted(key[order], np.arange(self._shape.prod() + 1))

    def _bin_of(self, places: NDArray[np.float64]) -> NDArray[np.int64]:
        return np.clip(np.floor((places - self._low) / self._bin_size).astype(np.int64), 0, self._shape - 1)

    def winding(self, points_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Signed crossings above each point, shape (N,): the winding number of a closed surface about it."""
        winding = np.zeros(len(points_m))
        for hits in self._hits(points_m):
            winding += np.bincount(hits.point, hits.sign, minlength=len(points_m))
        return winding.astype(np.int64)

    def winding_in_columns(
        self, places_m: NDArray[np.float64], heights_m: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """What `winding` says of the points of upright columns, each of which takes one ray, shape (K, Z).

        Args:
            places_m: Where the columns stand in the plane, shape (K, 2).
            heights_m: Rising heights of the points of each column, shape (Z,).
        """
        n_columns, n_heights = len(places_m), len(heights_m)
        points_m = np.column_stack([places_m, np.full(n_columns, heights_m[0])])
        steps = np.zeros(n_columns * n_heights)
        for hits in self._hits(points_m):
            # A crossing counts for all points below it, of which the highest has this number.
            highest = np.searchsorted(heights_m, hits.height_m, side="left") - 1
            steps += np.bincount(hits.point * n_heights + highest, hits.sign, minlength=len(steps))
        above = np.cumsum(steps.reshape(n_columns, n_heights)[:, ::-1], axis=1)
        return above[:, ::-1].astype(np.int64)

    def count_above(self, points_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Number of crossings above each point, whatever their sign, shape (N,)."""
        count = np.zeros(len(points_m), dtype=np.int64)
        for hits in self._hits(points_m):
            count += np.bincount(hits.point, minlength=len(points_m))
        return count

    def highest(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height z [m] of the highest crossing above each point, NaN where there is none, shape (N,)."""
        highest = np.full(len(points_m), -np.inf)
        for hits in self._hits(points_m):
            np.maximum.at(highest, hits.point, hits.height_m)
        return np.where(np.isneginf(highest), np.nan, highest)

    def _hits(self, points_m: NDArray[np.float64]) -> Iterator[_Hits]:
        """The crossings above the points, in chunks of bounded memory."""
        places = points_m[:, :2] + SHIFT_M
        is_over = ((places >= self._low) & (places <= self._low + self._bin_size * self._shape)).all(axis=1)
        candidates = np.flatnonzero(is_over)
        bins = self._bin_of(places[candidates])
        key = bins[:, 0] * self._shape[1] + bins[:, 1]
        n_triangles = self._start[key + 1] - self._start[key]
        ends = np.cumsum(n_triangles)
        n_pairs = int(ends[-1]) if len(ends) else 0
        cuts = (
            np.searchsorted(ends, np.arange(CHUNK_PAIRS, n_pairs + CHUNK_PAIRS, CHUNK_PAIRS), side="left") + 1
        )
        for chunk in np.split(np.arange(len(candidates)), np.unique(np.minimum(cuts, len(candidates)))):
            if len(chunk):
                point = np.repeat(candidates[chunk], n_triangles[chunk])
                before = np.cumsum(n_triangles[chunk]) - n_triangles[chunk]
                within = np.arange(len(point)) - np.repeat(before, n_triangles[chunk])
                triangle = self._triangles[np.repeat(self._start[key[chunk]], n_triangles[chunk]) + within]
                yield self._cross(points_m, places, point, triangle)

    def _cross(
        self,
        points_m: NDArray[np.float64],
        places: NDArray[np.float64],
        point: NDArray[np.int64],
        triangle: NDArray[np.int64],
    ) -> _Hits:
        # Each edge's test leaves fewer pairs for the next.
        for k in range(3):
            x, y = places[point, 0], places[point, 1]
            line = self._lines[k][triangle]
            side = line[:, 2] * (y - line[:, 1]) - line[:, 3] * (x - line[:, 0])
            is_within = (side > 0.0) == self._is_left[k][triangle]
            point, triangle = point[is_within], triangle[is_within]
        offset = places[point] - self._origin_m[triangle, :2]
        height_m = self._origin_m[triangle, 2] + np.einsum("ij,ij->i", self._slope[triangle], offset)
        is_above = height_m > points_m[point, 2]
        return _Hits(point[is_above], self._sign[triangle[is_above]], height_m[is_above])


def _edge_lines(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int64], sign: NDArray[np.int64]
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.bool_]]]:
    """For each of the three edges: its origin and direction in the plane, (F, 4), and its inner side."""
    lines, is_left = [], []
    for k in range(3):
        tail, head = faces[:, k], faces[:, (k + 1) % 3]
        start, end = vertices_m[np.minimum(tail, head), :2], vertices_m[np.maximum(tail, head), :2]
        lines.append(np.hstack([start, end - start]))
        is_left.append((tail < head) == (sign > 0))
    return lines, is_left

"""Some triangles, prepared to find the closest of their points to one point after another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class TrianglePatch:
    """Triangles with all that does not depend on the point worked out: a point then takes a dozen array operations.

    `surface_distance.closest_points_on_triangles` takes many points at once, and ten times longer for a single one.

    Args:
        corners_m: Corners [m], shape (N, 3 corners, 3), N at least 1.
    """

    def __init__(self, corners_m: Array) -> None:
        """Edges, normals, and the directions from each edge into its triangle, in the triangle's plane."""
        # Arrays of edges have shape (3 edges, N, 3).
        self._starts_m = corners_m.transpose(1, 0, 2)
        self._edges_m = np.roll(self._starts_m, -1, axis=0) - self._starts_m
        squared = np.square(self._edges_m).sum(axis=2)
        self._per_squared = np.divide(1.0, squared, out=np.zeros_like(squared), where=squared > 0.0)
        normals = np.cross(self._edges_m[0], self._edges_m[1])
        area = np.linalg.norm(normals, axis=1, keepdims=True)
        self._has_area = area[:, 0] > 0.0
        self.normals = np.divide(normals, area, out=np.zeros_like(normals), where=area > 0.0)
        self._inwards_m = np.cross(self.normals[None], self._edges_m)

    def closest(self, point_m: Array) -> tuple[Array, int, float]:
        """The closest point of all triangles (3,) [m], the row of its triangle, and its distance [m]."""
        from_starts_m = point_m - self._starts_m
        along = (from_starts_m * self._edges_m).sum(axis=2) * self._per_squared
        on_edges_m = np.clip(along, 0.0, 1.0)[..., None] * self._edges_m
        squared = np.square(from_starts_m - on_edges_m).sum(axis=2)
        is_over = ((from_starts_m * self._inwards_m).sum(axis=2) >= 0.0).all(axis=0) & self._has_area
        height_m = (from_starts_m[0] * self.normals).sum(axis=1)
        squared_all = np.where(is_over, np.square(height_m), squared.min(axis=0))
        row = int(np.argmin(squared_all))
        if is_over[row]:
            closest_m = point_m - height_m[row] * self.normals[row]
        else:
            edge = int(np.argmin(squared[:, row]))
            closest_m = self._starts_m[edge, row] + on_edges_m[edge, row]
        return closest_m, row, float(np.sqrt(squared_all[row]))

"""The organ's surface as many small pieces: what a probe's force is spread over, and what the organ rests on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sim.world.errors import TissueError
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import closest_points_on_triangles, divide_triangles

Array = NDArray[np.float64]

PIECE_SHARE = 0.35
"""Longest edge of a piece as a share of a cell's."""
DOWN_COSINE = 0.2
"""A piece faces down whose normal points below the horizon by more than the arc sine of this, some 12 degrees."""


@dataclass(frozen=True, eq=False)
class OuterSurface:
    """Pieces of an organ's surface.

    Attributes:
        points_m: Their middles [m], shape (P, 3).
        areas_m2: Their areas [m^2], shape (P,).
        normals: Their outward unit normals, shape (P, 3).
        corners_m: Their corners [m], shape (P, 3 corners, 3).
    """

    points_m: Array
    areas_m2: Array
    normals: Array
    corners_m: Array

    @classmethod
    def of(cls, organ: Solid, cell_size_m: float) -> OuterSurface:
        """The surface in pieces that are small beside a cell."""
        corners_m, owner = divide_triangles(organ, PIECE_SHARE * cell_size_m)
        edges_m = corners_m[:, 1:] - corners_m[:, :1]
        areas_m2 = 0.5 * np.linalg.norm(np.cross(edges_m[:, 0], edges_m[:, 1]), axis=1)
        return cls(corners_m.mean(axis=1), areas_m2, organ.face_normals()[owner], corners_m)

    def around(self, point_m: Array, radius_m: float) -> NDArray[np.int64]:
        """The pieces whose middles lie in a ball, shape (K,)."""
        return np.sort(np.asarray(self._tree.query_ball_point(point_m, radius_m), dtype=np.int64))

    @cached_property
    def spans_m(self) -> Array:
        """Lengths of the surface along the axes [m], shape (3,)."""
        return np.ptp(self.corners_m.reshape(-1, 3), axis=0)

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.points_m)

    @cached_property
    def _piece_reach_m(self) -> float:
        """No point of a piece is farther from its middle than this [m]."""
        return float(np.linalg.norm(self.corners_m - self.points_m[:, None], axis=2).max())

    def closest_to(self, point_m: Array) -> Array:
        """The point of the surface closest to a place [m], shape (3,)."""
        nearest_m = float(self._tree.query(point_m)[0])
        near = self.corners_m[self._tree.query_ball_point(point_m, nearest_m + self._piece_reach_m)]
        closest_m = closest_points_on_triangles(np.broadcast_to(point_m, (len(near), 3)), near)
        return closest_m[np.linalg.norm(closest_m - point_m, axis=1).argmin()]

    def rests(self, parts: NDArray[np.int64], height_share: float) -> NDArray[np.bool_]:
        """Which pieces lie on the organ's bed, shape (P,).

        Args:
            parts: The connected part of the organ that each piece belongs to, shape (P,).
            height_share: Share of each part's height above its lowest point that lies in the bed.

        Raises:
            TissueError: A part has nothing that faces down there.
        """
        is_resting = np.zeros(len(self.points_m), dtype=np.bool_)
        height_m, is_down = self.points_m[:, 2], self.normals[:, 2] < -DOWN_COSINE
        for part in np.unique(parts):
            is_part = parts == part
            low_m, high_m = height_m[is_part].min(), height_m[is_part].max()
            bed = is_part & is_down & (height_m <= low_m + height_share * (high_m - low_m))
            if not self.areas_m2[bed].sum() > 0.0:
                raise TissueError(
                    f"nothing of the organ faces down in the lowest {height_share:.3g} of its height, so that it rests "
                    "on nothing: set a larger rest_height_share, or check which way its triangles face"
                )
            is_resting |= bed
        return is_resting

"""The true surface of an organ at one moving point: signed distance and outward normal, exact at sharp rims too.

The triangles are divided into pieces of short edges, and a KD-tree holds the pieces' centroids. Around the point, the
triangles of all pieces within a radius make a patch, which is kept while it certainly holds the closest triangle: no
surface point is farther than `REACH_M` from the centroid of its piece, so a patch of radius R about c holds it for all
points p whose distance d to the patch fulfils d + |p - c| + REACH_M <= R.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import divide_triangles
from sim.world.solids.triangle_patch import TrianglePatch

PIECE_EDGE_M = 0.002
"""Longest edge of the pieces."""
REACH_M = PIECE_EDGE_M * 2.0 / 3.0
"""No point of a triangle is farther from its centroid than two thirds of its longest median, nor that of an edge."""
SLACK_M = 0.001
"""How far the point can move, at least, before the patch is gathered again."""
ON_SURFACE_M = 1e-9
"""Closer than this, a direction from the closest point means nothing and the triangle's own normal is taken."""


class ContactSurface:
    """Distance and normal for one point at a time, fastest where a point is near the one before.

    What is kept between points (the patch, and the last ball that the surface does not enter) changes no result.

    Args:
        solid: The solid whose surface is meant.
    """

    def __init__(self, solid: Solid) -> None:
        """Divide the triangles and build the tree."""
        self._solid = solid
        self._corners_m = solid.vertices_m[solid.faces]
        pieces, self._piece_face = divide_triangles(solid, PIECE_EDGE_M)
        self._tree = KDTree(pieces.mean(axis=1))
        self._patch: TrianglePatch | None = None
        self._patch_centre_m, self._patch_radius_m = np.zeros(3), 0.0
        self._ball_centre_m, self._ball_radius_m, self._ball_is_inside = np.zeros(3), 0.0, False

    def signed_distance_and_normal(self, point_m: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Signed distance to the surface and the direction out of the solid.

        Args:
            point_m: Query point [m], shape (3,).

        Returns:
            Distance [m], negative inside, and the unit vector in which it grows fastest, shape (3,).
        """
        closest_m, normal, distance_m = self._closest(point_m)
        if distance_m < ON_SURFACE_M:
            return 0.0, normal.copy()
        outward = (point_m - closest_m) / distance_m
        return (-distance_m, -outward) if self._is_inside(point_m, distance_m) else (distance_m, outward)

    def clearance_m(self, point_m: NDArray[np.float64]) -> float:
        """How far the point can move, at least, without touching the solid [m]; 0 inside. Cheap from afar."""
        away_m = float(self._tree.query(point_m)[0]) - REACH_M
        return 0.0 if away_m <= 0.0 or self._is_inside(point_m, away_m) else away_m

    def _closest(
        self, point_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """The closest point of the surface [m], its triangle's normal, and its distance [m]."""
        if self._patch is not None:
            closest_m, row, distance_m = self._patch.closest(point_m)
            moved_m = float(np.linalg.norm(point_m - self._patch_centre_m))
            if distance_m + moved_m + REACH_M <= self._patch_radius_m:
                return closest_m, self._patch.normals[row], distance_m
        # The nearest centroid lies on the surface, so the closest point is no farther. Moving by the slack lengthens
        # both the way to the closest point and that to the patch's centre.
        radius_m = float(self._tree.query(point_m)[0]) + REACH_M + 2.0 * SLACK_M
        faces = np.unique(self._piece_face[self._tree.query_ball_point(point_m, radius_m)])
        self._patch = TrianglePatch(self._corners_m[faces])
        self._patch_centre_m, self._patch_radius_m = point_m.copy(), radius_m
        closest_m, row, distance_m = self._patch.closest(point_m)
        return closest_m, self._patch.normals[row], distance_m

    def _is_inside(self, point_m: NDArray[np.float64], free_m: float) -> bool:
        """Whether a point lies inside; no surface is nearer to it than `free_m`.

        A ball that the surface does not enter lies on one side of it, so the winding number is counted once per ball.
        """
        if np.linalg.norm(point_m - self._ball_centre_m) >= self._ball_radius_m:
            self._ball_is_inside = bool(self._solid.contains(point_m[None])[0])
            self._ball_centre_m, self._ball_radius_m = point_m.copy(), free_m
        return self._ball_is_inside

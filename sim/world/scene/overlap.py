"""Overlap: how deep a round geom, or one that points stand for, stands in another one, by the true shape of both.

MuJoCo takes the convex hull of a mesh, within which there may be all the room in the world, as between the fingers of
a gripper. Where the hull is overlapped, the mesh's triangles decide: the depth is that of their deepest point in the
round geom. It is found by halving triangles, since a distance changes by no more than the way gone.
"""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sim.world.solids.crossings import VerticalCrossings
from sim.world.solids.surface_distance import halve_triangles

from .geom_shapes import mesh_triangles
from .probe_surface import strewn_points

Array = NDArray[np.float64]

FAR_M = 10.0
"""Distances beyond this are not measured further."""
LEAF_M = 2.5e-4
"""Triangles are halved until none of their points is farther than this from their centroid."""
MAX_LEAVES = 20_000
"""Most triangles that are halved at a time: the deepest, of a mesh that lies in the geom with many."""
HALF_TURN = 0.5
"""Where the triangles wind about a point more often than this, it is inside the mesh."""


def overlap_m(model: mujoco.MjModel, data: mujoco.MjData, round_geom: int, geom: int) -> float:
    """How deep a sphere, capsule or cylinder and another geom overlap [m]; 0 where they do not.

    Args:
        model: The scene.
        data: A state whose kinematics are up to date.
        round_geom: The id of a sphere, capsule or cylinder.
        geom: The id of a geom of any kind but a plane or a height field.
    """
    depth_m = -mujoco.mj_geomDistance(model, data, round_geom, geom, FAR_M, None)
    if depth_m <= 0.0 or model.geom_dataid[geom] < 0:
        return max(0.0, float(depth_m))
    triangles_m = _triangles_in(model, data, geom, round_geom)
    if abs(_winding(triangles_m)) > HALF_TURN:
        return float(depth_m)
    return max(0.0, -_least_distance_m(triangles_m, model, round_geom))


def depth_of_points_m(
    model: mujoco.MjModel, data: mujoco.MjData, geom_with_points: int, points_m: Array, geom: int
) -> float:
    """How deep points of one geom lie in another geom [m]; 0 where none does.

    Args:
        model: The scene.
        data: A state whose kinematics are up to date.
        geom_with_points: The id of the geom that the points belong to, of any shape.
        points_m: The points in its frame [m], shape (N, 3).
        geom: The id of a geom of any kind but a plane or a height field.
    """
    if not len(points_m):
        return 0.0
    R_own, R_other = (data.geom_xmat[each].reshape(3, 3) for each in (geom_with_points, geom))
    world_m = data.geom_xpos[geom_with_points] + points_m @ R_own.T
    in_geom_m = (world_m - data.geom_xpos[geom]) @ R_other
    return max(0.0, float(-_signed_distance_m(model, geom, in_geom_m).min()))


def _signed_distance_m(model: mujoco.MjModel, geom: int, points_m: Array) -> Array:
    """Signed distance of points, in its own frame, from a geom [m], shape (N,); of an ellipsoid a bound on it."""
    kind, size_m = int(model.geom_type[geom]), model.geom_size[geom]
    if model.geom_dataid[geom] >= 0:
        crossings, surface = _mesh_index(model, geom)
        is_inside = crossings.winding(points_m) != 0
        distance_m = np.full(len(points_m), FAR_M)
        distance_m[is_inside] = -surface.query(points_m[is_inside])[0]
        return distance_m
    if kind == int(mujoco.mjtGeom.mjGEOM_BOX):
        beyond_m = np.abs(points_m) - size_m
        return np.linalg.norm(np.maximum(beyond_m, 0.0), axis=1) + np.minimum(beyond_m.max(axis=1), 0.0)
    if kind == int(mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        return (np.linalg.norm(points_m / size_m, axis=1) - 1.0) * float(size_m.min())
    return _round_distance_m(model, geom, points_m)


@lru_cache(maxsize=4)
def _mesh_index(model: mujoco.MjModel, geom: int) -> tuple[VerticalCrossings, KDTree]:
    """What tells whether points lie in a mesh and how deep; it is asked for one configuration after the other."""
    triangles_m = mesh_triangles(model, geom)
    corners_m, index = np.unique(triangles_m.reshape(-1, 3), axis=0, return_inverse=True)
    return VerticalCrossings(corners_m, index.reshape(-1, 3)), KDTree(strewn_points(model, geom))


def _triangles_in(model: mujoco.MjModel, data: mujoco.MjData, geom: int, frame_geom: int) -> Array:
    """The triangles of a mesh in the frame of another geom [m], shape (N, 3 corners, 3)."""
    R_world_geom, R_world_frame = (data.geom_xmat[each].reshape(3, 3) for each in (geom, frame_geom))
    world_m = data.geom_xpos[geom] + mesh_triangles(model, geom) @ R_world_geom.T
    return (world_m - data.geom_xpos[frame_geom]) @ R_world_frame


def _winding(triangles_m: Array) -> float:
    """How often triangles wind about the origin: 1 in a closed mesh, 0 outside (Van Oosterom and Strackee, 1983)."""
    a, b, c = triangles_m.transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    solid = la * lb * lc
    for first, second, length in ((a, b, lc), (b, c, la), (c, a, lb)):
        solid += np.einsum("ij,ij->i", first, second) * length
    return float(np.arctan2(volume, solid).sum() / (2.0 * np.pi))


def _least_distance_m(triangles_m: Array, model: mujoco.MjModel, geom: int) -> float:
    """The least signed distance of triangles' points, in a round geom's frame, from its surface [m]."""
    least_m = np.inf
    while len(triangles_m):
        centroids_m = triangles_m.mean(axis=1)
        reach_m = np.linalg.norm(triangles_m - centroids_m[:, None], axis=2).max(axis=1)
        distance_m = _round_distance_m(model, geom, centroids_m)
        least_m = min(least_m, float(distance_m.min()))
        bound_m = distance_m - reach_m
        rows = np.flatnonzero((reach_m > LEAF_M) & (bound_m < min(least_m - LEAF_M, 0.0)))
        rows = rows[np.argsort(bound_m[rows])[:MAX_LEAVES]]
        triangles_m = halve_triangles(triangles_m[rows])
    return least_m


def _round_distance_m(model: mujoco.MjModel, geom: int, points_m: Array) -> Array:
    """Signed distance of points, in its own frame, from a sphere, capsule or cylinder [m], shape (N,)."""
    radius_m, half_m = model.geom_size[geom, :2]
    beyond_m = np.abs(points_m[:, 2]) - half_m
    across_m = np.hypot(points_m[:, 0], points_m[:, 1])
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.linalg.norm(points_m, axis=1) - radius_m
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return np.hypot(across_m, np.maximum(beyond_m, 0.0)) - radius_m
    outside_m = np.hypot(np.maximum(across_m - radius_m, 0.0), np.maximum(beyond_m, 0.0))
    return outside_m + np.minimum(np.maximum(across_m - radius_m, beyond_m), 0.0)

"""The surface of a MuJoCo geom in triangles, and a proof that it stays out of a solid, apart from `Clearance`."""

from __future__ import annotations

import mujoco
import numpy as np
import trimesh

from sim.world.solids.surface_distance import SurfaceDistance

LEAF_M = 0.0006
"""Triangles are halved until none of their points is farther than this from their centroid."""


def geom_triangles(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Triangles of a geom's surface in its own frame [m], shape (N, 3 corners, 3).

    Round geoms are enclosed: the polyhedron is blown up by what its faces cut off.
    """
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]].astype(float)
        return _triangles(trimesh.convex.convex_hull(vertices))  # MuJoCo collides the hull
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _triangles(trimesh.creation.box(2.0 * size))
    n = 24
    cut = 1.0 / np.cos(np.pi / n) ** 2
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _triangles(trimesh.creation.cylinder(size[0] * cut, 2.0 * size[1], sections=n))
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        capsule = trimesh.creation.capsule(2.0 * size[1], size[0] * cut, count=[n, n])
        capsule.apply_translation(-capsule.bounds.mean(axis=0))
        return _triangles(capsule)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return _triangles(trimesh.creation.uv_sphere(size[0] * cut, count=[n, n]))
    raise NotImplementedError(f"geom {geom} is a {kind.name}")


def least_signed_distances_m(
    triangles_m: np.ndarray, exact: SurfaceDistance, *, ignored_at_m: np.ndarray, ignored_m: float
) -> np.ndarray:
    """Least signed distance to a solid of what can touch it, per state: below 0 where it does, inf if nothing can.

    A triangle whose centroid is farther from the solid's surface than its own farthest point cannot cross it. All
    others are halved; where they are small, the centroid counts.

    Args:
        triangles_m: World frame [m], shape (T states, N, 3 corners, 3).
        exact: Distances to the solid.
        ignored_at_m: Points around which the solid may be touched, shape (T, 3).
        ignored_m: How far around them; 0 for not at all.
    """
    least_m = np.full(len(triangles_m), np.inf)
    owner = np.repeat(np.arange(len(triangles_m)), triangles_m.shape[1])
    triangles_m = triangles_m.reshape(-1, 3, 3)
    while len(triangles_m):
        centroids_m = triangles_m.mean(axis=1)
        reach_m = np.linalg.norm(triangles_m - centroids_m[:, None], axis=2).max(axis=1)
        from_tip_m = np.linalg.norm(triangles_m - ignored_at_m[owner, None], axis=2).max(axis=1)
        is_open = from_tip_m > ignored_m
        is_open[is_open] = (
            exact.distance_m(centroids_m[is_open]) < reach_m[is_open] + 1e-4
        )  # what it may be wrong by
        is_leaf = is_open & (reach_m <= LEAF_M)
        if is_leaf.any():
            np.minimum.at(least_m, owner[is_leaf], exact.signed_distance_m(centroids_m[is_leaf]))
        is_split = is_open & ~is_leaf
        triangles_m, owner = _halves(triangles_m[is_split]), np.tile(owner[is_split], 2)
    return least_m


def _triangles(mesh: trimesh.Trimesh) -> np.ndarray:
    return np.asarray(mesh.vertices)[np.asarray(mesh.faces)]


def _halves(triangles_m: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(np.roll(triangles_m, -1, axis=1) - triangles_m, axis=2)
    turn = (lengths.argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles_m, turn[..., None], axis=1).transpose(1, 0, 2)
    middle = (a + b) / 2.0
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])

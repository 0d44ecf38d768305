"""Shapes: what stands for a geom where its distance to the organ is wanted.

For a capsule these are spheres along its axis, for any other geom triangles: a mesh's as they are, and for a round body
flat faces that enclose it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

from sim.world.solids.crossings import VerticalCrossings
from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.surface_tree import SurfaceTree

Array = NDArray[np.float64]

ENCLOSED_M = 2e-4
"""The flat faces around a round body stand off from it by no more than this [m]."""
MAX_SECTIONS = 256
"""Of the flat faces around a round body; one of more than 2.6 m radius stands off farther."""
LEAST_SIZE_M = 1e-6
"""A geom thinner than this is taken for as thin as this [m]."""

LEAST_SPACING_M = 0.0005
"""Spheres along a capsule are no nearer to each other than this [m]."""
MAX_POINTS = 1_000_000
"""Points that are looked at together, for the sake of memory: those of long, thin geoms in many configurations."""
MAX_SHORTFALL_M = 0.002
"""Spheres along a capsule miss no more than this of it [m]."""


@dataclass(frozen=True, eq=False)
class SphereCover:
    """Spheres that stand for one geom, in the geom's frame."""

    centres_m: NDArray[np.float64]
    """Shape (N, 3)."""
    radii_m: NDArray[np.float64]
    """Shape (N,); 0 for points."""

    @property
    def points_m(self) -> NDArray[np.float64]:
        """The centres, for spheres of no radius [m], shape (N, 3)."""
        return self.centres_m

    @property
    def reach_m(self) -> float:
        """How far the spheres reach from the frame's origin [m]."""
        return float(np.max(np.linalg.norm(self.centres_m, axis=1) + self.radii_m))

    def distances_m(
        self,
        organ: DistanceGrid,
        at_m: NDArray[np.float64],
        R_world_geom: NDArray[np.float64],
        _far_m: Array | float = np.inf,
    ) -> NDArray[np.float64]:
        """Signed distance to the organ with the geom's frame in N places, shape (N,) [m]."""
        least_m = np.empty(len(at_m))
        n_parts = max(1, int(np.ceil(len(at_m) * len(self.radii_m) / MAX_POINTS)))
        for rows in np.array_split(np.arange(len(at_m)), n_parts):
            world_m = at_m[rows, None] + self.centres_m @ R_world_geom[rows].transpose(0, 2, 1)
            distances_m = organ.distance_m(world_m.reshape(-1, 3)).reshape(len(rows), -1)
            least_m[rows] = (distances_m - self.radii_m).min(axis=1)
        return least_m


class GeomSurface:
    """The surface of one geom in the geom's frame, and how near it comes to the organ.

    Args:
        model: The scene.
        geom: The id of a geom of any kind but a plane or a height field.
    """

    def __init__(self, model: mujoco.MjModel, geom: int) -> None:
        """Make the triangles; the tree over them waits for its first use."""
        self._triangles_m = geom_triangles(model, geom)
        self._tree = SurfaceTree(self._triangles_m)
        self.reach_m = self._tree.reach_m

    def distances_m(
        self, organ: DistanceGrid, at_m: Array, R_world_geom: Array, far_m: Array | float = np.inf
    ) -> Array:
        """Signed distance to the organ with the geom's frame in N places, shape (N,) [m]; see `SurfaceTree`.

        An organ that lies in the geom as a whole counts as entered by as much as it is from its own middle to its
        surface.
        """
        distances_m = self._tree.distances_m(organ, at_m, R_world_geom, far_m)
        deepest_m, depth_m = organ.deepest
        # What is smaller than the organ cannot hold it.
        if depth_m > self.reach_m:
            return distances_m
        from_middle_m = np.linalg.norm(deepest_m - at_m, axis=1)
        rows = np.flatnonzero((distances_m > 0.0) & (from_middle_m <= self.reach_m - depth_m))
        in_geom_m = np.einsum("nij,ni->nj", R_world_geom[rows], deepest_m - at_m[rows])
        held = rows[self._crossings.winding(in_geom_m) > 0]
        distances_m[held] = -depth_m
        return distances_m

    @cached_property
    def points_m(self) -> Array:
        """Points of the surface, none of which is farther from the next than the tree's triangles are long [m]."""
        return np.unique(self._tree.corners_m.reshape(-1, 3), axis=0)

    @cached_property
    def _crossings(self) -> VerticalCrossings:
        corners_m = self._triangles_m.reshape(-1, 3)
        vertices_m, index = np.unique(corners_m, axis=0, return_inverse=True)
        return VerticalCrossings(vertices_m, index.reshape(-1, 3))


def axis_spheres(model: mujoco.MjModel, geom: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Spheres along a capsule's axis, half a radius apart, so that they miss at most 3 % of its radius.

    Those of a wire are half a millimetre apart: what they miss is less than that. Those of a thick one are nearer to
    each other, so that they miss no more than `MAX_SHORTFALL_M`.

    Returns:
        Centres in the geom's frame [m], shape (N, 3), and radii [m], shape (N,); one sphere for a sphere.
    """
    radius_m = float(model.geom_size[geom, 0])
    is_capsule = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
    half_m = float(model.geom_size[geom, 1]) if is_capsule else 0.0
    apart_m = max(0.5 * radius_m, LEAST_SPACING_M)
    if radius_m > MAX_SHORTFALL_M:
        apart_m = min(apart_m, 2.0 * np.sqrt(radius_m**2 - (radius_m - MAX_SHORTFALL_M) ** 2))
    n = int(np.ceil(2.0 * half_m / apart_m)) + 1
    z_m = np.linspace(-half_m, half_m, n) if is_capsule else np.zeros(1)
    return np.column_stack([0 * z_m, 0 * z_m, z_m]), np.full(len(z_m), radius_m)


def geom_triangles(model: mujoco.MjModel, geom: int) -> Array:
    """Triangles of a geom's surface in the geom's frame [m], shape (N, 3 corners, 3); round bodies lie within them."""
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    if model.geom_dataid[geom] >= 0 and kind == mujoco.mjtGeom.mjGEOM_MESH:
        return mesh_triangles(model, geom)
    a, b, c = np.maximum(model.geom_size[geom], LEAST_SIZE_M)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _triangles_m(trimesh.creation.box((2.0 * a, 2.0 * b, 2.0 * c)))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        n, radius_m = _sections(a)
        return _triangles_m(trimesh.creation.cylinder(radius_m, 2.0 * b, sections=n))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        ball_m = _enclosing_ball_m(float(max(a, b, c)))
        return ball_m / max(a, b, c) * np.array([a, b, c])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        ball_m = _enclosing_ball_m(float(a))
        # The hull of both ends.
        ends_m = np.concatenate([ball_m.reshape(-1, 3) + np.array([0.0, 0.0, z_m]) for z_m in (-b, b)])
        return _triangles_m(trimesh.convex.convex_hull(ends_m))
    return _enclosing_ball_m(float(a))


def mesh_triangles(model: mujoco.MjModel, geom: int) -> Array:
    """The triangles of a mesh geom in the geom's frame [m], shape (N, 3 corners, 3)."""
    mesh = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices_m = model.mesh_vert[first : first + count].astype(np.float64)
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return vertices_m[model.mesh_face[first : first + count]]


def _sections(radius_m: float) -> tuple[int, float]:
    """How many flat faces around a circle stand off by at most `ENCLOSED_M`, and their corners' radius [m]."""
    n = int(np.ceil(np.pi / np.arccos(radius_m / (radius_m + ENCLOSED_M))))
    n = min(max(n, 8), MAX_SECTIONS)
    return n, radius_m / float(np.cos(np.pi / n))


def _enclosing_ball_m(radius_m: float) -> Array:
    """Triangles around a ball about the origin [m], shape (N, 3 corners, 3)."""
    n_splits = int(np.searchsorted((0.01, 0.04, 0.16), radius_m)) + 2
    triangles_m = _triangles_m(trimesh.creation.icosphere(subdivisions=n_splits, radius=radius_m))
    normals = np.cross(triangles_m[:, 1] - triangles_m[:, 0], triangles_m[:, 2] - triangles_m[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # The nearest face of the ball's triangles lies within; enlarged, it touches the ball.
    return triangles_m * (radius_m / float(np.einsum("ij,ij->i", normals, triangles_m[:, 0]).min()))


def _triangles_m(mesh: trimesh.Trimesh) -> Array:
    return np.asarray(mesh.vertices, dtype=np.float64)[np.asarray(mesh.faces)]

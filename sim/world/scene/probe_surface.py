"""The probe's surface: the points that stand for it, its face, its mount, and how it lies about its beam.

The face is the part that may touch the organ: what lies in the site `face`, or all of the geom `face`, or, where a
probe has neither, what is within `FACE_RADIUS_M` of the tip.
"""

from __future__ import annotations

import copy

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from sim.world.frames import quaternion_matrix
from sim.world.probes.rigid_probe import FACE
from sim.world.solids.surface_distance import halve_triangles

from .geom_shapes import geom_triangles

Array = NDArray[np.float64]

FACE_NAME = f"probe_{FACE}"
"""What site or geom `face` of a probe's file is called in a scene."""
FACE_RADIUS_M = 0.008
"""The face of a probe that names none, the embedded one among them: a ball of this radius about the tip [m]."""
SURFACE_SPACING_M = 0.004
"""Spacing of the points that stand for a probe geom's surface."""
CELL_M, MANY_POINTS = 0.002, 3000
"""Of more points than this, as fine meshes have them, one is kept in each cell of this size [m]."""
COVER_M = SURFACE_SPACING_M / np.sqrt(3.0) + CELL_M * np.sqrt(3.0)
"""No point of a surface is farther than this from one of those that stand for it [m]."""
LEAST_SIZE_M = 1e-9
"""An ellipsoid thinner than this is taken for as thin as this [m]."""
MOUNT_M = 0.05
"""This much of the probe, from the flange on, may stand in the link that carries it [m]: crude arms end in a ball about
the flange, and half of a clamp of 34 mm radius may be countersunk."""
ALONG_Z = 1e-9
"""An axis whose cosine with the flange's z misses 1 by no more than this lies along it."""
ROUND_M = 1e-6
"""What lies this near to the beam lies on it [m]."""


class ProbeSurface:
    """The surface of a scene's probe, and which of it is the face.

    Args:
        model: The scene.
        geoms: The probe's geoms that collide.
        tip: The id of the tip's site.
        is_own: Whether it is a user's probe, whose geoms may have any shape. Those of the embedded one are short and
            round, and fewer points stand for them.
    """

    def __init__(self, model: mujoco.MjModel, geoms: list[int], tip: int, *, is_own: bool) -> None:
        """Strew the points."""
        strewn_m = {
            geom: strewn_points(model, geom) if is_own else surface_points(model, geom) for geom in geoms
        }
        is_face = {geom: _is_face(model, geom, each, tip) for geom, each in strewn_m.items()}
        self.in_geom_m = {
            geom: each[~is_face[geom]] for geom, each in strewn_m.items() if not is_face[geom].all()
        }
        """Points of each geom that are not on the face, in the geom's frame [m], shape (N, 3); a geom that is all face
        is left out."""
        self.in_tip_m = {geom: _in_tip(model, geom, each, tip) for geom, each in self.in_geom_m.items()}
        """The same in the tip's frame [m], shape (N, 3)."""
        whole_m = [_in_tip(model, geom, each, tip) for geom, each in strewn_m.items()]
        self.reach_m = max(float(np.linalg.norm(each, axis=1).max()) for each in whole_m)
        """How far the probe reaches from its tip [m]."""
        self.face_radius_m = FACE_RADIUS_M
        """Radius of the flat disc with the area that the face has, seen along the beam [m]."""
        if _names_face(model):
            faces_m = [each[is_face[geom]] for geom, each in zip(geoms, whole_m, strict=True)]
            self.face_radius_m = _disc_radius_m(np.vstack(faces_m))
        self.is_round = not is_own or _is_round(model, geoms, tip)
        """Whether it is the same however it is turned about its beam."""


def strewn_points(model: mujoco.MjModel, geom: int) -> Array:
    """Points on the surface of a geom of any shape in its own frame [m], shape (N, 3); see `COVER_M`."""
    triangles_m, points_m = geom_triangles(model, geom), []
    while len(triangles_m):
        edges_m = np.linalg.norm(np.roll(triangles_m, -1, axis=1) - triangles_m, axis=2)
        is_long = edges_m.max(axis=1) > SURFACE_SPACING_M
        points_m.append(triangles_m[~is_long].reshape(-1, 3))
        triangles_m = halve_triangles(triangles_m[is_long])
    corners_m = np.unique(np.concatenate(points_m), axis=0)
    if len(corners_m) <= MANY_POINTS:
        return corners_m
    cells = np.floor(corners_m / CELL_M).astype(np.int64)
    return corners_m[np.unique(cells, axis=0, return_index=True)[1]]


def _names_face(model: mujoco.MjModel) -> bool:
    kinds = (mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_GEOM)
    return any(mujoco.mj_name2id(model, kind, FACE_NAME) >= 0 for kind in kinds)


def _is_face(model: mujoco.MjModel, geom: int, points_m: Array, tip: int) -> NDArray[np.bool_]:
    """Which points of one of the probe's geoms, in its frame, lie on the face, shape (N,)."""
    placed_m = in_body_m(model, geom, points_m)
    if not _names_face(model):
        return np.linalg.norm(placed_m - model.site_pos[tip], axis=1) <= FACE_RADIUS_M
    is_face = np.full(len(points_m), model.geom(geom).name == FACE_NAME)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, FACE_NAME)
    if site >= 0:
        in_site_m = (placed_m - model.site_pos[site]) @ quaternion_matrix(model.site_quat[site])
        is_face |= _contains(model.site_type[site], model.site_size[site], in_site_m)
    return is_face


def _disc_radius_m(points_m: Array) -> float:
    """Radius of the disc whose area is that of points' outline along z [m]."""
    across_m = points_m[:, :2]
    if len(points_m) < 3 or np.linalg.matrix_rank(across_m - across_m[0], tol=ROUND_M) < 2:
        return FACE_RADIUS_M
    # In the plane a hull's volume is its area.
    return float(np.sqrt(ConvexHull(across_m).volume / np.pi))


def _is_round(model: mujoco.MjModel, geoms: list[int], tip: int) -> bool:
    """Whether all shapes of a probe, and that of its face, lie about the beam as a lathe would make them."""
    shapes = [
        (int(model.geom_type[geom]), model.geom_size[geom], model.geom_pos[geom], model.geom_quat[geom])
        for geom in geoms
    ]
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, FACE_NAME)
    if site >= 0:
        shapes.append(
            (int(model.site_type[site]), model.site_size[site], model.site_pos[site], model.site_quat[site])
        )
    return all(_is_about_beam(*shape, model=model, tip=tip) for shape in shapes)


def _is_about_beam(
    kind: int, size_m: Array, at_m: Array, quaternion: Array, *, model: mujoco.MjModel, tip: int
) -> bool:
    R_body_tip = quaternion_matrix(model.site_quat[tip])
    beside_m = ((at_m - model.site_pos[tip]) @ R_body_tip)[:2]
    if np.linalg.norm(beside_m) > ROUND_M:
        return False
    if kind == int(mujoco.mjtGeom.mjGEOM_SPHERE):
        return True
    is_ellipsoid = kind == int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
    is_lathed = kind in (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER)) or (
        is_ellipsoid and abs(float(size_m[0] - size_m[1])) < ROUND_M
    )
    aside = quaternion_matrix(quaternion)[:, 2] @ R_body_tip[:, :2]
    return is_lathed and float(np.linalg.norm(aside)) < ROUND_M


def _in_tip(model: mujoco.MjModel, geom: int, points_m: Array, tip: int) -> Array:
    """Points in a geom's frame, taken to the tip's [m], shape (N, 3)."""
    R_body_tip = quaternion_matrix(model.site_quat[tip])
    return (in_body_m(model, geom, points_m) - model.site_pos[tip]) @ R_body_tip


def in_body_m(model: mujoco.MjModel, geom: int, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points in a geom's frame, taken to its body's [m], shape (N, 3)."""
    return points_m @ quaternion_matrix(model.geom_quat[geom]).T + model.geom_pos[geom]


def surface_points(model: mujoco.MjModel, geom: int) -> NDArray[np.float64]:
    """Points on a geom's surface in its own frame [m], shape (N, 3)."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    # Every other primitive is a convex body about its centre: shoot an even set of directions at its boundary.
    n = int(np.clip(4.0 * np.pi * (float(np.max(size)) / SURFACE_SPACING_M) ** 2, 60, 250))
    directions = _even_directions(n)
    return directions * _boundary_range(kind, size, directions)[:, None]


def _boundary_range(
    kind: int, size: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance [m] from a primitive's centre to its boundary along each direction."""
    low, high = np.zeros(len(directions)), np.full(len(directions), 2.0 * float(np.linalg.norm(size)))
    # The bodies are star-shaped about their centre, so bisection finds the boundary.
    for _ in range(40):
        middle = (low + high) / 2.0
        inside = _contains(kind, size, directions * middle[:, None])
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low


def _contains(kind: int, size: NDArray[np.float64], points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether points lie in a primitive, in its own frame."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return np.all(np.abs(points_m) <= size, axis=1)
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return np.linalg.norm(points_m / np.maximum(size, LEAST_SIZE_M), axis=1) <= 1.0
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return (np.hypot(points_m[:, 0], points_m[:, 1]) <= size[0]) & (np.abs(points_m[:, 2]) <= size[1])
    half_m = size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
    beyond_m = np.maximum(np.abs(points_m[:, 2]) - half_m, 0.0)
    return np.hypot(np.hypot(points_m[:, 0], points_m[:, 1]), beyond_m) <= size[0]


def _even_directions(n: int) -> NDArray[np.float64]:
    """Unit vectors spread evenly over the sphere (Fibonacci lattice), shape (n, 3)."""
    i = np.arange(n) + 0.5
    z = 1.0 - 2.0 * i / n
    turn = np.pi * (1.0 + np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - z**2)
    return np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])


def is_lathed(model: mujoco.MjModel, geom: int) -> bool:
    """Whether one of the probe's geoms is a sphere, or a capsule or cylinder along the flange's z."""
    kind = int(model.geom_type[geom])
    is_along = abs(float(quaternion_matrix(model.geom_quat[geom])[2, 2])) > 1.0 - ALONG_Z
    return kind == int(mujoco.mjtGeom.mjGEOM_SPHERE) or (
        is_along and kind in (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER))
    )


def without_mount(model: mujoco.MjModel, probe: list[int]) -> mujoco.MjModel:
    """A copy of a scene whose probe begins `MOUNT_M` from the flange; geoms that end before have no size.

    Its geoms are lathed; see `is_lathed`.
    """
    cut = copy.copy(model)
    outward = np.array([0.0, 0.0, 1.0])
    for geom in probe:
        # Where a geom lies is then taken from its own numbers, and not from a body's frame that it shared.
        cut.geom_sameframe[geom] = 0
        is_capsule = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
        is_cylinder = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER
        along_m, cap_m = (
            float(model.geom_pos[geom] @ outward),
            0.0 if is_cylinder else model.geom_size[geom, 0],
        )
        half_m = cap_m + (model.geom_size[geom, 1] if is_capsule or is_cylinder else 0.0)
        end_m = along_m + half_m
        if end_m - 2.0 * half_m >= MOUNT_M:
            continue
        left_m = (end_m - MOUNT_M) / 2.0 - cap_m
        if left_m <= 0.0:
            cut.geom_size[geom] = 0.0
            continue
        cut.geom_size[geom, 1] = left_m
        cut.geom_pos[geom] += (end_m - cap_m - left_m - along_m) * outward
    return cut

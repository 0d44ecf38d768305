"""Clearance: how far arm and probe are from touching what they must not touch.

Contacts with the table and of the arm with itself come from MuJoCo. The organ is different: MuJoCo would touch its
convex hull, so its clearance is read from a signed distance grid of the true surface, at spheres and points that cover
the geoms of arm and probe. Only the probe's face, within `FACE_RADIUS_M` of the tip, may touch the organ.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from .distance_grid import DistanceGrid
from .scene import Scene

FACE_RADIUS_M = 0.008
"""The probe's face: the part of the probe that is meant to touch the organ."""
ARM_MARGIN_M = 0.003
"""Room kept between the organ and the arm; covers the grid's interpolation error and the spheres' gaps."""
PROBE_MARGIN_M = 0.0
"""The probe's flanks may come as close as they like, but not under the surface."""
SURFACE_SPACING_M = 0.004
"""Spacing of the points that stand for a probe geom's surface."""
MAX_MESH_POINTS = 200
"""Vertices of an arm's mesh geom that stand for it."""


@dataclass(frozen=True)
class Collision:
    """The closest forbidden pair of a state."""

    pair: tuple[str, str]
    """Names of the two geoms; `organ` is the true organ surface."""
    distance_m: float
    """Signed distance between them [m]; negative is penetration."""

    def __str__(self) -> str:
        """Both names and the depth in millimetres."""
        verb = "penetrates" if self.distance_m < 0 else "comes too close to"
        return f"{self.pair[0]} {verb} {self.pair[1]} ({self.distance_m * 1e3:+.1f} mm)"


class Clearance:
    """Decides whether a state touches what it must not."""

    def __init__(self, scene: Scene, organ_distance: DistanceGrid) -> None:
        """Cover the scene's arm and probe geoms with spheres; `organ_distance` is the organ's distance grid."""
        model = scene.model
        self._model = model
        self._grid = organ_distance
        self._tip_id = model.site(scene.tip_site).id
        self._geoms = np.array(sorted(scene.arm_geoms), dtype=np.int64)
        covers = [_cover(model, int(geom), self._tip_id) for geom in self._geoms]
        self._covers = dict(zip(self._geoms.tolist(), covers, strict=True))
        is_probe = model.geom_bodyid[self._geoms] == model.site_bodyid[self._tip_id]
        self._margin_m = np.where(is_probe, PROBE_MARGIN_M, ARM_MARGIN_M)
        # The spheres are centred in the geom's frame; how far they reach from its origin bounds each geom.
        self._bound_m = np.array([np.max(np.linalg.norm(at, axis=1) + radius_m) for at, radius_m in covers])
        self._probe_points_m, self._probe_geom = _in_tip_frame(
            model, self._geoms[is_probe], self._covers, self._tip_id
        )

    def collision(self, data: mujoco.MjData) -> Collision | None:
        """The worst forbidden contact of a state, or None when it is free.

        Args:
            data: A state whose kinematics are up to date; its contacts are computed here.
        """
        mujoco.mj_collision(self._model, data)
        if data.ncon:
            worst = min(data.contact[: data.ncon], key=lambda contact: contact.dist)
            if worst.dist < 0.0:
                return Collision((self._name(worst.geom1), self._name(worst.geom2)), float(worst.dist))
        near_m = self._grid.distance_m(data.geom_xpos[self._geoms]) - self._bound_m
        for index in np.flatnonzero(near_m < self._margin_m):
            geom = int(self._geoms[index])
            at, radius_m = self._covers[geom]
            points_m = data.geom_xpos[geom] + at @ data.geom_xmat[geom].reshape(3, 3).T
            distance_m = float(np.min(self._grid.distance_m(points_m) - radius_m))
            if distance_m < self._margin_m[index]:
                return Collision((self._name(geom), "organ"), distance_m)
        return None

    def probe_collision(self, T_world_probe: NDArray[np.float64]) -> Collision | None:
        """Whether the probe alone, with its tip at this frame, would enter the organ.

        No configuration of the arm can mend such a pose but by rolling, and the embedded probe is round.

        Args:
            T_world_probe: Frame of the tip, shape (4, 4).
        """
        points_m = self._probe_points_m @ T_world_probe[:3, :3].T + T_world_probe[:3, 3]
        distance_m = self._grid.distance_m(points_m)
        index = int(np.argmin(distance_m))
        if distance_m[index] >= PROBE_MARGIN_M:
            return None
        return Collision((self._name(int(self._probe_geom[index])), "organ"), float(distance_m[index]))

    def _name(self, geom: int) -> str:
        body = self._model.body(self._model.geom_bodyid[geom]).name
        return self._model.geom(geom).name or body


def _in_tip_frame(
    model: mujoco.MjModel,
    geoms: NDArray[np.int64],
    covers: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]],
    tip_id: int,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The probe's cover points in the tip's frame (N, 3) [m], and their geoms (N,)."""
    R_body_tip = _rotation(model.site_quat[tip_id])
    parts = []
    for geom in geoms:
        in_body_m = covers[int(geom)][0] @ _rotation(model.geom_quat[geom]).T + model.geom_pos[geom]
        parts.append((in_body_m - model.site_pos[tip_id]) @ R_body_tip)
    owner = np.repeat(geoms, [len(part) for part in parts])
    return np.vstack(parts), owner


def _rotation(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrix of a wxyz quaternion, shape (3, 3)."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def _cover(model: mujoco.MjModel, geom: int, tip_id: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sphere centres in the geom's frame (N, 3) [m] and radii (N,) [m] that stand for one geom."""
    is_probe = model.geom_bodyid[geom] == model.site_bodyid[tip_id]
    if not is_probe and model.geom_type[geom] in (
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_SPHERE,
    ):
        return _axis_spheres(model, geom)
    points_m = _surface_points(model, geom)
    if is_probe:
        in_body_m = points_m @ _rotation(model.geom_quat[geom]).T + model.geom_pos[geom]
        points_m = points_m[np.linalg.norm(in_body_m - model.site_pos[tip_id], axis=1) > FACE_RADIUS_M]
    return points_m, np.zeros(len(points_m))


def _axis_spheres(model: mujoco.MjModel, geom: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Spheres along a capsule's axis, half a radius apart, so that they miss at most 3 % of its radius."""
    radius_m = float(model.geom_size[geom, 0])
    is_capsule = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
    half_m = float(model.geom_size[geom, 1]) if is_capsule else 0.0
    n = int(np.ceil(4.0 * half_m / radius_m)) + 1
    z_m = np.linspace(-half_m, half_m, n) if is_capsule else np.zeros(1)
    return np.column_stack([0 * z_m, 0 * z_m, z_m]), np.full(len(z_m), radius_m)


def _surface_points(model: mujoco.MjModel, geom: int) -> NDArray[np.float64]:
    """Points on a geom's surface in its own frame [m], shape (N, 3)."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        vertices_m = model.mesh_vert[first : first + count].astype(np.float64)
        return vertices_m[:: max(1, count // MAX_MESH_POINTS)]
    # Every other primitive is a convex body about its centre: shoot an even set of directions at its boundary.
    n = int(np.clip(4.0 * np.pi * (float(np.max(size)) / SURFACE_SPACING_M) ** 2, 60, 250))
    directions = _even_directions(n)
    return directions * _boundary_range(kind, size, directions)[:, None]


def _boundary_range(
    kind: int, size: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance [m] from a primitive's centre to its boundary along each direction."""
    low, high = np.zeros(len(directions)), np.full(len(directions), 2.0 * float(np.linalg.norm(size)))
    for _ in range(40):  # bisection: the bodies are star-shaped about their centre
        middle = (low + high) / 2.0
        inside = _contains(kind, size, directions * middle[:, None])
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low


def _contains(kind: int, size: NDArray[np.float64], points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether points lie in a primitive, in its own frame."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return np.all(np.abs(points_m) <= size, axis=1)
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return np.linalg.norm(points_m / size, axis=1) <= 1.0
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

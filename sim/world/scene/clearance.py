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

from sim.world.frames import quaternion_matrix
from sim.world.solids.distance_grid import DistanceGrid

from .scene import Scene

FACE_RADIUS_M = 0.008
"""The probe's face: the part of the probe that is meant to touch the organ."""
ARM_MARGIN_M = 0.003
"""Room kept between organ and arm [m]; it covers the grid's interpolation error and what the spheres leave out."""
PROBE_MARGIN_M = 0.0
"""The probe's flanks may come as close as they like, but not under the surface."""
SURFACE_SPACING_M = 0.004
"""Spacing of the points that stand for a probe geom's surface."""
FAR_M = 0.1
"""Distances beyond this are not measured further when many states are looked at."""
PROBE_FAR_M = 0.003
"""The same for the probe, whose work is near the organ."""
LEAST_SIZE_M = 1e-9
"""An ellipsoid thinner than this is taken for as thin as this [m]."""
LEAST_SPACING_M = 0.0005
"""Spheres along a capsule are no nearer to each other than this [m]."""
MAX_POINTS = 1_000_000
"""Points that are looked at together, for the sake of memory: those of long, thin geoms in many configurations."""
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
        self.organ_distance = organ_distance
        self._tip_id = model.site(scene.tip_site).id
        self._geoms = np.array(sorted(scene.arm_geoms), dtype=np.int64)
        covers = [_cover(model, int(geom), self._tip_id) for geom in self._geoms]
        self._covers = dict(zip(self._geoms.tolist(), covers, strict=True))
        is_probe = model.geom_bodyid[self._geoms] == model.site_bodyid[self._tip_id]
        self._margin_m = np.where(is_probe, PROBE_MARGIN_M, ARM_MARGIN_M)
        # The spheres are centred in the geom's frame; how far they reach from its origin bounds each geom.
        self._bound_m = np.array([np.max(np.linalg.norm(at, axis=1) + radius_m) for at, radius_m in covers])
        self._is_probe = is_probe
        self._probe_points_m = _in_tip_frame(model, self._geoms[is_probe], self._covers, self._tip_id)

    def collision(self, data: mujoco.MjData) -> Collision | None:
        """The worst forbidden contact of a state, or None when it is free.

        Args:
            data: A state whose kinematics are up to date; its contacts are computed here.
        """
        mujoco.mj_collision(self._model, data)
        if data.ncon:
            worst = min(data.contact[: data.ncon], key=lambda contact: contact.dist)
            if worst.dist < 0.0:
                return Collision((self.name(worst.geom1), self.name(worst.geom2)), float(worst.dist))
        near_m = self.organ_distance.distance_m(data.geom_xpos[self._geoms]) - self._bound_m
        for index in np.flatnonzero(near_m < self._margin_m):
            geom = int(self._geoms[index])
            at, radius_m = self._covers[geom]
            points_m = data.geom_xpos[geom] + at @ data.geom_xmat[geom].reshape(3, 3).T
            distance_m = float(np.min(self.organ_distance.distance_m(points_m) - radius_m))
            if distance_m < self._margin_m[index]:
                return Collision((self.name(geom), "organ"), distance_m)
        return None

    def probe_collision(self, T_world_probe: NDArray[np.float64]) -> Collision | None:
        """How the probe itself, with its tip at this frame, would enter the organ; None where it would not.

        Only a roll about the beam could mend such a pose, and the embedded probe is round.

        Args:
            T_world_probe: Frame of the tip, shape (4, 4).
        """
        distance_m, geom = self.probe_distances(T_world_probe[None, :3, 3], T_world_probe[None, :3, :3])
        if distance_m[0] >= PROBE_MARGIN_M:
            return None
        return Collision((self.name(int(geom[0])), "organ"), float(distance_m[0]))

    def probe_distances(
        self, tips_m: NDArray[np.float64], R_world_tip: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """How far the probe, but for its face, is from the organ at many frames of its tip.

        Args:
            tips_m: Positions of the tip [m], shape (N, 3).
            R_world_tip: Its orientations, shape (N, 3, 3).

        Returns:
            Signed distances [m] and ids of the closest geoms, shape (N,) each. Beyond `PROBE_FAR_M` it is
            a lower bound.
        """
        least_m, closest = np.full(len(tips_m), np.inf), np.zeros(len(tips_m), dtype=np.int64)
        for geom, points_m in self._probe_points_m.items():
            centre_m = points_m.mean(axis=0)
            reach_m = float(np.linalg.norm(points_m - centre_m, axis=1).max())
            distance_m = self.organ_distance.distance_m(tips_m + R_world_tip @ centre_m) - reach_m
            near = np.flatnonzero((distance_m < PROBE_FAR_M) & (distance_m < least_m))
            if not len(near):
                least_m = np.minimum(least_m, distance_m)
                continue
            world_m = tips_m[near, None] + points_m @ R_world_tip[near].transpose(0, 2, 1)
            distance_m[near] = (
                self.organ_distance.distance_m(world_m.reshape(-1, 3)).reshape(-1, len(points_m)).min(axis=1)
            )
            is_less = distance_m < least_m
            least_m, closest = np.where(is_less, distance_m, least_m), np.where(is_less, geom, closest)
        return least_m, closest

    def arm_distances(
        self, geoms_m: NDArray[np.float64], R_world_geoms: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """How far the arm, without the probe, is from the organ in many configurations.

        Args:
            geoms_m: Positions of all geoms of the scene [m], shape (N, n_geoms, 3).
            R_world_geoms: Their orientations, shape (N, n_geoms, 3, 3).

        Returns:
            Signed distances [m], beyond `FAR_M` a lower bound, and ids of the closest geoms, shape (N,) each.
        """
        arm = self._geoms[~self._is_probe]
        n = len(geoms_m)
        bound_m = self.organ_distance.distance_m(geoms_m[:, arm].reshape(-1, 3)).reshape(n, -1)
        bound_m -= self._bound_m[~self._is_probe]
        for column, geom in enumerate(arm):
            near = np.flatnonzero(bound_m[:, column] < FAR_M)
            if not len(near):
                continue
            at, radius_m = self._covers[int(geom)]
            for rows in np.array_split(near, int(np.ceil(len(near) * len(at) / MAX_POINTS))):
                world_m = geoms_m[rows, geom][:, None] + at @ R_world_geoms[rows, geom].transpose(0, 2, 1)
                distances_m = self.organ_distance.distance_m(world_m.reshape(-1, 3)).reshape(-1, len(at))
                bound_m[rows, column] = (distances_m - radius_m).min(axis=1)
        if not len(arm):
            return np.full(n, np.inf), np.zeros(n, dtype=np.int64)
        closest = np.argmin(bound_m, axis=1)
        return bound_m[np.arange(n), closest], arm[closest]

    def name(self, geom: int) -> str:
        """The name of a geom, or of its body where it has none."""
        body = self._model.body(self._model.geom_bodyid[geom]).name
        return self._model.geom(geom).name or body


def _in_tip_frame(
    model: mujoco.MjModel,
    geoms: NDArray[np.int64],
    covers: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]],
    tip_id: int,
) -> dict[int, NDArray[np.float64]]:
    """The cover points of each of the probe's geoms in the tip's frame [m], shape (N, 3)."""
    R_body_tip = quaternion_matrix(model.site_quat[tip_id])
    points_m = {}
    for geom in geoms.tolist():
        in_body_m = covers[geom][0] @ quaternion_matrix(model.geom_quat[geom]).T + model.geom_pos[geom]
        points_m[geom] = (in_body_m - model.site_pos[tip_id]) @ R_body_tip
    return points_m


def _cover(model: mujoco.MjModel, geom: int, tip_id: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sphere centres in the geom's frame (N, 3) [m] and radii (N,) [m] that stand for one geom."""
    is_probe = model.geom_bodyid[geom] == model.site_bodyid[tip_id]
    # int() for MuJoCo's enums: `in` compares them with NumPy's integers the wrong way round and finds nothing.
    if not is_probe and int(model.geom_type[geom]) in (
        int(mujoco.mjtGeom.mjGEOM_CAPSULE),
        int(mujoco.mjtGeom.mjGEOM_SPHERE),
    ):
        return axis_spheres(model, geom)
    points_m = surface_points(model, geom)
    if is_probe:
        in_body_m = points_m @ quaternion_matrix(model.geom_quat[geom]).T + model.geom_pos[geom]
        points_m = points_m[np.linalg.norm(in_body_m - model.site_pos[tip_id], axis=1) > FACE_RADIUS_M]
    return points_m, np.zeros(len(points_m))


def axis_spheres(model: mujoco.MjModel, geom: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Spheres along a capsule's axis, half a radius apart, so that they miss at most 3 % of its radius.

    Those of a wire are half a millimetre apart: what they miss is less than that.

    Returns:
        Centres in the geom's frame [m], shape (N, 3), and radii [m], shape (N,); one sphere for a sphere.
    """
    radius_m = float(model.geom_size[geom, 0])
    is_capsule = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
    half_m = float(model.geom_size[geom, 1]) if is_capsule else 0.0
    n = int(np.ceil(min(4.0 * half_m / radius_m, 2.0 * half_m / LEAST_SPACING_M))) + 1
    z_m = np.linspace(-half_m, half_m, n) if is_capsule else np.zeros(1)
    return np.column_stack([0 * z_m, 0 * z_m, z_m]), np.full(len(z_m), radius_m)


def surface_points(model: mujoco.MjModel, geom: int) -> NDArray[np.float64]:
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

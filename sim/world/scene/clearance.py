"""Clearance: how far arm and probe are from touching what they must not touch.

Contacts with the table and of the arm with itself come from MuJoCo. The organ is different: MuJoCo would touch its
convex hull, so its clearance is read from a signed distance grid of the true surface: at spheres along the capsules of
the arm, at the triangles of all its other geoms, a mesh's own, and at points on the probe. Only the probe's face,
within `FACE_RADIUS_M` of the tip, may touch the organ.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.frames import quaternion_matrix
from sim.world.solids.distance_grid import DistanceGrid

from .geom_shapes import GeomSurface, SphereCover, axis_spheres
from .scene import Scene

FACE_RADIUS_M = 0.008
"""The probe's face: the part of the probe that is meant to touch the organ."""
ARM_MARGIN_M = 0.003
"""Room kept between organ and arm [m]; it covers the grid's interpolation error and what spheres leave out."""
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
        """Prepare the shapes of arm and probe; `organ_distance` is the organ's distance grid."""
        model = scene.model
        self._model = model
        self.organ_distance = organ_distance
        self._tip_id = model.site(scene.tip_site).id
        self._geoms = np.array(sorted(scene.arm_geoms), dtype=np.int64)
        self._is_fixed = model.body_weldid[model.geom_bodyid] == 0
        is_probe = model.geom_bodyid[self._geoms] == model.site_bodyid[self._tip_id]
        self._margin_m = np.where(is_probe, PROBE_MARGIN_M, ARM_MARGIN_M)
        self._is_probe = is_probe
        self._shapes: dict[int, SphereCover | GeomSurface] = {
            geom: _shape(model, geom, self._tip_id if probe else None)
            for geom, probe in zip(self._geoms.tolist(), is_probe.tolist(), strict=True)
        }
        # How far a geom reaches from its own origin.
        self._bound_m = np.array([shape.reach_m for shape in self._shapes.values()])
        self._probe_points_m = _in_tip_frame(model, self._geoms[is_probe].tolist(), self._tip_id)

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
            R_world_geom = data.geom_xmat[geom].reshape(1, 3, 3)
            distance_m = float(
                self._shapes[geom].distances_m(
                    self.organ_distance, data.geom_xpos[geom : geom + 1], R_world_geom
                )[0]
            )
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
            geoms_m: Positions of all geoms of the scene [m], shape (N, n_geoms, 3), the base in one place.
            R_world_geoms: Their orientations, shape (N, n_geoms, 3, 3).

        Returns:
            Signed distances [m], beyond `FAR_M` a lower bound, and ids of the closest geoms, shape (N,) each.
        """
        arm = self._geoms[~self._is_probe]
        n = len(geoms_m)
        if not len(arm):
            return np.full(n, np.inf), np.zeros(n, dtype=np.int64)
        bound_m = self.organ_distance.distance_m(geoms_m[:, arm].reshape(-1, 3)).reshape(n, -1)
        bound_m -= self._bound_m[~self._is_probe]
        least_m = np.full(n, FAR_M)
        # Triangles take longer than spheres, and are held against what these left.
        for column in np.argsort([isinstance(self._shapes[geom], GeomSurface) for geom in arm.tolist()]):
            geom = int(arm[column])
            near = np.flatnonzero(bound_m[:, column] < least_m)
            if not len(near):
                continue
            # The base stands in the same place in all of them.
            rows, far_m = (near[:1], FAR_M) if self._is_fixed[geom] else (near, least_m[near])
            bound_m[near, column] = self._shapes[geom].distances_m(
                self.organ_distance, geoms_m[rows, geom], R_world_geoms[rows, geom], far_m
            )
            least_m[near] = np.minimum(least_m[near], bound_m[near, column])
        closest = np.argmin(bound_m, axis=1)
        return bound_m[np.arange(n), closest], arm[closest]

    def name(self, geom: int) -> str:
        """The name of a geom, or of its body where it has none."""
        body = self._model.body(self._model.geom_bodyid[geom]).name
        return self._model.geom(geom).name or body


def _in_tip_frame(model: mujoco.MjModel, geoms: list[int], tip_id: int) -> dict[int, NDArray[np.float64]]:
    """The points of each of the probe's geoms in the tip's frame [m], shape (N, 3)."""
    R_body_tip = quaternion_matrix(model.site_quat[tip_id])
    return {
        geom: (_in_body(model, geom, _probe_points(model, geom, tip_id)) - model.site_pos[tip_id])
        @ R_body_tip
        for geom in geoms
    }


def _shape(model: mujoco.MjModel, geom: int, tip_id: int | None) -> SphereCover | GeomSurface:
    """What stands for one geom: points if it is the probe's, with that tip."""
    if tip_id is not None:
        points_m = _probe_points(model, geom, tip_id)
        return SphereCover(points_m, np.zeros(len(points_m)))
    # int() for MuJoCo's enums: `in` compares them with NumPy's integers the wrong way round and finds nothing.
    if int(model.geom_type[geom]) in (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_SPHERE)):
        return SphereCover(*axis_spheres(model, geom))
    return GeomSurface(model, geom)


def _probe_points(model: mujoco.MjModel, geom: int, tip_id: int) -> NDArray[np.float64]:
    """Points on one of the probe's geoms, but not on its face, in the geom's frame [m], shape (N, 3)."""
    points_m = surface_points(model, geom)
    from_tip_m = _in_body(model, geom, points_m) - model.site_pos[tip_id]
    return points_m[np.linalg.norm(from_tip_m, axis=1) > FACE_RADIUS_M]


def _in_body(model: mujoco.MjModel, geom: int, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
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

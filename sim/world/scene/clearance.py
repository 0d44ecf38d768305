"""Clearance: how far arm and probe are from touching what they must not touch.

Contacts with the table and of the arm with itself come from MuJoCo. The organ is different: MuJoCo would touch its
convex hull, so its clearance is read from a signed distance grid of the true surface: at spheres along the capsules of
the arm, at the triangles of all its other geoms, a mesh's own, and at points on the probe. Only the probe's face may
touch the organ; `probe_surface.py` tells what that is.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.solids.distance_grid import DistanceGrid

from .geom_shapes import GeomSurface, SphereCover, axis_spheres
from .probe_surface import ProbeSurface
from .scene import Scene

ARM_MARGIN_M = 0.003
"""Room kept between organ and arm [m]; it covers the grid's interpolation error and what spheres leave out."""
PROBE_MARGIN_M = 0.0
"""The probe's flanks may come as close as they like, but not under the surface."""
FAR_M = 0.1
"""Distances beyond this are not measured further when many states are looked at."""
PROBE_FAR_M = 0.003
"""The same for the probe, whose work is near the organ."""
ROLLS = 36
"""Turns about the beam at which a probe that is not round is held against the organ."""


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
        geoms = sorted(scene.arm_geoms)
        probe = [geom for geom in geoms if model.geom_bodyid[geom] == model.site_bodyid[self._tip_id]]
        self.probe = ProbeSurface(model, probe, self._tip_id, is_own=scene.has_own_probe)
        # A geom that is all face may touch the organ.
        all_face = set(probe) - self.probe.in_geom_m.keys()
        self._geoms = np.array([geom for geom in geoms if geom not in all_face], dtype=np.int64)
        self._is_fixed = model.body_weldid[model.geom_bodyid] == 0
        is_probe = model.geom_bodyid[self._geoms] == model.site_bodyid[self._tip_id]
        self._margin_m = np.where(is_probe, PROBE_MARGIN_M, ARM_MARGIN_M)
        self._is_probe = is_probe
        self._shapes: dict[int, SphereCover | GeomSurface] = {
            geom: _points(self.probe.in_geom_m[geom]) if probe else _shape(model, geom)
            for geom, probe in zip(self._geoms.tolist(), is_probe.tolist(), strict=True)
        }
        # How far a geom reaches from its own origin.
        self._bound_m = np.array([shape.reach_m for shape in self._shapes.values()])

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

    def probe_distances(
        self, tips_m: NDArray[np.float64], R_world_tip: NDArray[np.float64], *, turn_rad: float = 0.0
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """How far the probe, but for its face, is from the organ at many frames of its tip.

        Args:
            tips_m: Positions of the tip [m], shape (N, 3).
            R_world_tip: Its orientations, shape (N, 3, 3).
            turn_rad: Half the range of turns about the beam that is meant: no point of the probe is farther from the
                organ in any of them than it is said to be.

        Returns:
            Signed distances [m] and ids of the closest geoms, shape (N,) each. Beyond `PROBE_FAR_M` it is
            a lower bound.
        """
        least_m, closest = np.full(len(tips_m), np.inf), np.zeros(len(tips_m), dtype=np.int64)
        for geom, points_m in self.probe.in_tip_m.items():
            centre_m = points_m.mean(axis=0)
            reach_m = float(np.linalg.norm(points_m - centre_m, axis=1).max())
            distance_m = self.organ_distance.distance_m(tips_m + R_world_tip @ centre_m) - reach_m
            near = np.flatnonzero((distance_m < PROBE_FAR_M) & (distance_m < least_m))
            if not len(near):
                least_m = np.minimum(least_m, distance_m)
                continue
            world_m = tips_m[near, None] + points_m @ R_world_tip[near].transpose(0, 2, 1)
            of_points_m = self.organ_distance.distance_m(world_m.reshape(-1, 3)).reshape(-1, len(points_m))
            if turn_rad:
                of_points_m += turn_rad * np.hypot(points_m[:, 0], points_m[:, 1])
            distance_m[near] = of_points_m.min(axis=1)
            is_less = distance_m < least_m
            least_m, closest = np.where(is_less, distance_m, least_m), np.where(is_less, geom, closest)
        return least_m, closest

    def best_turn_distances(
        self, tips_m: NDArray[np.float64], R_world_tip: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """No less than how far the probe, but for its face, can be from the organ, however it is turned about its beam.

        A round probe is the same in all turns. Any other is looked at in `ROLLS` of them; between two of these a point
        moves by no more than its distance from the beam times half the turn, which is added to its distance. So a room
        below 0 is a proof that the probe enters the organ, and one of 0 or more is none that it does not.

        Args:
            tips_m: Positions of the tip [m], shape (N, 3).
            R_world_tip: Its orientations, at any turn about the beam, shape (N, 3, 3).

        Returns:
            Distances [m] and ids of the closest geoms in the best turn, shape (N,) each.
        """
        if self.probe.is_round:
            return self.probe_distances(tips_m, R_world_tip)
        room_m, closest = np.full(len(tips_m), -np.inf), np.zeros(len(tips_m), dtype=np.int64)
        for turn_rad in np.arange(ROLLS) * (2.0 * np.pi / ROLLS):
            rows = np.flatnonzero(room_m < PROBE_MARGIN_M)
            if not len(rows):
                break
            cos, sin = np.cos(turn_rad), np.sin(turn_rad)
            R_turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
            found_m, geom = self.probe_distances(
                tips_m[rows], R_world_tip[rows] @ R_turn, turn_rad=np.pi / ROLLS
            )
            is_better = found_m > room_m[rows]
            room_m[rows[is_better]], closest[rows[is_better]] = found_m[is_better], geom[is_better]
        return room_m, closest

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


def _points(points_m: NDArray[np.float64]) -> SphereCover:
    return SphereCover(points_m, np.zeros(len(points_m)))


def _shape(model: mujoco.MjModel, geom: int) -> SphereCover | GeomSurface:
    """What stands for a geom of the arm."""
    # int() for MuJoCo's enums: `in` compares them with NumPy's integers the wrong way round and finds nothing.
    if int(model.geom_type[geom]) in (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_SPHERE)):
        return SphereCover(*axis_spheres(model, geom))
    return GeomSurface(model, geom)

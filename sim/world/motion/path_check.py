"""Whether the arm moves freely along a path of configurations, also between those that are looked at."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.frames import quaternion_matrix
from sim.world.ik.chain import Array, Chain
from sim.world.scene.clearance import ARM_MARGIN_M, Clearance, Collision
from sim.world.scene.clearance_meter import ClearanceMeter, Clearances
from sim.world.scene.geom_shapes import axis_spheres
from sim.world.scene.probe_surface import COVER_M, strewn_points
from sim.world.scene.scene import Scene
from sim.world.solids.distance_grid import DistanceGrid

COARSE_M = 0.2
"""Most that any point of the arm moves between the configurations that are looked at first [m]."""
FINEST_M = 0.004
"""Where no point of the arm can move farther than this, two free configurations are taken as joined freely."""
MOST_ALLOWANCE_M = 0.005
"""Room that the ends of a path may lack: the margin of this check and what the spheres around the probe add."""
CAPSULE_SHORTFALL = 0.03
"""Spheres along a capsule's axis miss up to this share of its radius."""


@dataclass(frozen=True, eq=False)
class Room:
    """What is left before a forbidden contact in N configurations."""

    room_m: Array
    """Distance that is left [m], negative within a contact, shape (N,)."""
    clearances: Clearances
    """Of the arm."""
    probe_m: Array
    """Distance of the probe from the organ [m], shape (N,)."""
    probe_geom: NDArray[np.int64]
    """The geom of that distance, shape (N,)."""


class PathCheck:
    """Checks joint paths of a scene's arm with the probe lifted off the organ.

    No point of the arm moves farther than sum_i |dq_i| lever_i between two configurations, where lever_i is the
    greatest distance of a point beyond joint i from its axis. If both have more room together than that, no contact
    lies between them; otherwise the interval is halved, down to `FINEST_M`.
    """

    def __init__(self, scene: Scene, chain: Chain, meter: ClearanceMeter, clearance: Clearance) -> None:
        """Bound the levers of `chain` and cover the probe with spheres."""
        self._chain, self._meter, self._clearance = chain, meter, clearance
        self._grid: DistanceGrid = clearance.organ_distance
        self.levers_m = _levers_m(scene, chain)
        self._probe_at_m, self._probe_radius_m, self._probe_geoms = _probe_spheres(scene)

    def motion_m(self, start: Array, end: Array) -> Array:
        """Bound on how far any point of the arm moves between configurations, shape (N,) [m]."""
        return np.abs(end - start) @ self.levers_m

    def first_hit(self, path: Array) -> Collision | None:
        """A forbidden contact on the way along configurations joined by straight lines, or None.

        The ends were accepted by the inverse kinematics, which lets the probe be nearer to the organ than this check.
        It may then be as near all the way.

        Args:
            path: Configurations of the chain, shape (N, n), N at least 2. The probe is lifted along all of it.
        """
        ends_m = self._probe_distances(path[[0, -1]])[0].min()
        margin_m = float(np.clip(ends_m, ARM_MARGIN_M - MOST_ALLOWANCE_M, ARM_MARGIN_M))
        q = self._sampled(path)
        found = self._room(q, margin_m)
        room_m = found.room_m
        while found.room_m.min() >= 0.0:
            motion_m = self.motion_m(q[:-1], q[1:])
            open_rows = np.flatnonzero((motion_m > room_m[:-1] + room_m[1:]) & (motion_m > FINEST_M))
            if not len(open_rows):
                return None
            middle = (q[open_rows] + q[open_rows + 1]) / 2.0
            found = self._room(middle, margin_m)
            q = np.insert(q, open_rows + 1, middle, axis=0)
            room_m = np.insert(room_m, open_rows + 1, found.room_m)
        return self._hit(found, int(np.argmin(found.room_m)))

    def is_free(self, path: Array) -> bool:
        """Whether the way along configurations is free."""
        return self.first_hit(path) is None

    def is_lifted(self, q: Array) -> bool:
        """Whether nothing touches in a configuration, shape (n,), and the whole probe keeps its margin."""
        return bool(self._room(q[None], ARM_MARGIN_M).room_m[0] >= 0.0)

    def _room(self, q: Array, margin_m: float) -> Room:
        """Room of configurations of the chain, shape (N, n), the probe keeping a margin from the organ."""
        clearances = self._meter.measure(self._chain.full(q))
        probe_m, geom = self._probe_distances(q)
        arm_m = np.minimum(clearances.contact_m, clearances.organ_m - ARM_MARGIN_M) - clearances.padding_m
        room_m = np.minimum(arm_m, probe_m - margin_m)
        return Room(room_m, clearances, probe_m, geom)

    def _hit(self, room: Room, index: int) -> Collision:
        """What stands in the way in one of the configurations."""
        hit = self._meter.collision(room.clearances, index)
        if hit is not None:
            return hit
        return Collision(
            (self._clearance.name(int(room.probe_geom[index])), "organ"), float(room.probe_m[index])
        )

    def _sampled(self, path: Array) -> Array:
        """The path with enough configurations between its own that none is farther than `COARSE_M` from the next."""
        parts = [path[:1]]
        for start, end in pairwise(path):
            n = max(1, int(np.ceil(self.motion_m(start, end) / COARSE_M)))
            parts.append(start + (np.arange(1, n + 1) / n)[:, None] * (end - start))
        return np.vstack(parts)

    def _probe_distances(self, q: Array) -> tuple[Array, NDArray[np.int64]]:
        """Distance of the whole probe, its face too, from the organ [m], and the closest geom, shape (N,) each."""
        state = self._chain.forward(q)
        world_m = state.tips_m[:, None] + self._probe_at_m @ state.R_world_tip.transpose(0, 2, 1)
        distances_m = self._grid.distance_m(world_m.reshape(-1, 3)).reshape(len(q), -1) - self._probe_radius_m
        closest = np.argmin(distances_m, axis=1)
        return distances_m[np.arange(len(q)), closest], self._probe_geoms[closest]


def _levers_m(scene: Scene, chain: Chain) -> Array:
    """Greatest distance of any point of arm and probe beyond each joint from the joint's axis [m], 1 for slides."""
    model = scene.model
    levers_m = np.zeros(chain.n_joints)
    for row, joint in enumerate(chain.joints):
        if chain.is_slide[row]:
            levers_m[row] = 1.0
            continue
        for geom in scene.arm_geoms:
            levers_m[row] = max(levers_m[row], _lever_m(model, int(joint), geom))
    return levers_m


def _lever_m(model: mujoco.MjModel, joint: int, geom: int) -> float:
    """Bound on the distance of a geom's points from a joint's anchor, whatever the joints between do; 0 if above."""
    owner, body = int(model.jnt_bodyid[joint]), int(model.geom_bodyid[geom])
    lever_m = float(np.linalg.norm(model.geom_pos[geom])) + float(model.geom_rbound[geom])
    while body not in (owner, 0):
        lever_m += float(np.linalg.norm(model.body_pos[body]))
        first = int(model.body_jntadr[body])
        for other in range(first, first + int(model.body_jntnum[body])):
            if model.jnt_type[other] == mujoco.mjtJoint.mjJNT_SLIDE:
                lever_m += float(np.abs(model.jnt_range[other]).max())
            else:
                lever_m += 2.0 * float(np.linalg.norm(model.jnt_pos[other]))
        body = int(model.body_parentid[body])
    return lever_m + float(np.linalg.norm(model.jnt_pos[joint])) if body == owner else 0.0


def _probe_spheres(scene: Scene) -> tuple[Array, Array, NDArray[np.int64]]:
    """Spheres that hold the probe's surface: centres in the tip's frame (N, 3) [m], radii (N,) [m], and their geoms.

    One sphere holds the embedded probe's clamp, which never comes near the organ. Any other geom that is no capsule is
    held by many small ones.
    """
    model = scene.model
    tip = model.site(scene.tip_site).id
    R_body_tip = quaternion_matrix(model.site_quat[tip])
    centres_m, radii_m, geoms = [], [], []
    for geom in sorted(scene.arm_geoms):
        if model.geom_bodyid[geom] != model.site_bodyid[tip]:
            continue
        if int(model.geom_type[geom]) in (
            int(mujoco.mjtGeom.mjGEOM_CAPSULE),
            int(mujoco.mjtGeom.mjGEOM_SPHERE),
        ):
            at_m, radius_m = axis_spheres(model, geom)
            radius_m = radius_m * (1.0 + CAPSULE_SHORTFALL)
        elif scene.has_own_probe:
            at_m = strewn_points(model, geom)
            radius_m = np.full(len(at_m), COVER_M)
        else:
            at_m, radius_m = np.zeros((1, 3)), model.geom_rbound[geom : geom + 1].copy()
        in_body_m = at_m @ quaternion_matrix(model.geom_quat[geom]).T + model.geom_pos[geom]
        centres_m.append((in_body_m - model.site_pos[tip]) @ R_body_tip)
        radii_m.append(radius_m)
        geoms.append(np.full(len(at_m), geom))
    return np.vstack(centres_m), np.concatenate(radii_m), np.concatenate(geoms).astype(np.int64)

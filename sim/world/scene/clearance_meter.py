"""Clearances: how far the arm is from the table, from itself and from the organ, in many configurations at once."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from .clearance import ARM_MARGIN_M, FAR_M, PROBE_MARGIN_M, Clearance, Collision
from .geom_pairs import GeomPairs, standing_pairs
from .probe_room import MOUNT
from .scene import Scene


@dataclass(frozen=True, eq=False)
class Clearances:
    """Clearances of N configurations; distances beyond `FAR_M` are not told apart."""

    contact_m: NDArray[np.float64]
    """Least distance of arm and probe to the table and to each other [m], but of pairs whose distance no joint changes,
    which count only where they overlap; shape (N,)."""
    contact_pair: NDArray[np.int64]
    """The two geoms of that distance, -1 where nothing is within `FAR_M`, shape (N, 2)."""
    organ_m: NDArray[np.float64]
    """Least distance of the arm, without the probe, to the organ [m], shape (N,)."""
    organ_geom: NDArray[np.int64]
    """The geom of that distance, shape (N,)."""
    padding_m: float = 0.0
    """Room that is kept beyond not touching [m], and beyond `ARM_MARGIN_M` from the organ."""

    @property
    def is_free(self) -> NDArray[np.bool_]:
        """Whether nothing comes nearer than it may, shape (N,); the probe on the organ is left out."""
        return (self.contact_m >= self.padding_m) & (self.organ_m >= ARM_MARGIN_M + self.padding_m)

    @property
    def clearance_m(self) -> NDArray[np.float64]:
        """The least of all distances [m], at most `FAR_M`, shape (N,)."""
        return np.minimum(np.minimum(self.contact_m, self.organ_m), FAR_M)


class ClearanceMeter:
    """Measures the clearances of configurations of a scene's arm."""

    def __init__(self, scene: Scene, clearance: Clearance) -> None:
        """Prepare a copy of the scene in which MuJoCo reports pairs up to `FAR_M` apart."""
        self._model = copy.copy(scene.model)
        # The margins of the two geoms of a pair add up.
        self._model.geom_margin[:] = FAR_M / 2.0
        self._model.pair_margin[:] = FAR_M
        # Bodies have the largest margin of their geoms, by which MuJoCo chooses the pairs that it looks at.
        self._model.body_margin[:] = FAR_M / 2.0
        self._data = mujoco.MjData(self._model)
        self._clearance = clearance
        self._standing = standing_pairs(self._model)
        self._padding_m = 0.0
        self._pairs: GeomPairs | None = None

    def with_padding(self, padding_m: float) -> ClearanceMeter:
        """The same meter, by which a configuration is free only if this room is left around arm and probe [m].

        With padding the distances to the table and of the arm to itself are true ones (`GeomPairs`), which takes
        several times as long; without it they are those of MuJoCo's contacts.
        """
        padded = copy.copy(self)
        padded._padding_m = padding_m
        padded._pairs = (self._pairs or GeomPairs(self._model, self._standing)) if padding_m > 0.0 else None
        return padded

    def at_base(self, T_world_base: NDArray[np.float64]) -> ClearanceMeter:
        """The same meter with the arm's base at another frame, shape (4, 4)."""
        moved = copy.copy(self)
        moved._model = copy.copy(self._model)
        mount = moved._model.body(MOUNT)
        mount.pos[:] = T_world_base[:3, 3]
        mujoco.mju_mat2Quat(mount.quat, np.ascontiguousarray(T_world_base[:3, :3]).ravel())
        moved._data = mujoco.MjData(moved._model)
        return moved

    def measure(self, q: NDArray[np.float64]) -> Clearances:
        """The clearances at joint positions of the whole scene, shape (N, nq)."""
        model, data, n = self._model, self._data, len(q)
        contact_m, pair = np.full(n, np.inf), np.full((n, 2), -1, dtype=np.int64)
        geoms_m = np.empty((n, model.ngeom, 3))
        R_world_geoms = np.empty((n, model.ngeom, 9))
        for i in range(n):
            data.qpos[:] = q[i]
            mujoco.mj_kinematics(model, data)
            geoms_m[i], R_world_geoms[i] = data.geom_xpos, data.geom_xmat
            if self._pairs is not None:
                contact_m[i], pair[i] = self._pairs.least_distance(model, data, FAR_M)
                continue
            mujoco.mj_collision(model, data)
            if data.ncon:
                contact_m[i], pair[i] = self._closest(data.contact.dist, data.contact.geom)
        organ_m, organ_geom = self._clearance.arm_distances(
            geoms_m, R_world_geoms.reshape(n, model.ngeom, 3, 3)
        )
        return Clearances(contact_m, pair, organ_m, organ_geom, self._padding_m)

    def _closest(
        self, distances_m: NDArray[np.float64], geoms: NDArray[np.int32]
    ) -> tuple[float, NDArray[np.int32] | int]:
        """The least distance of contacts [m] and its two geoms, but of those pairs whose distance no joint changes."""
        if self._standing:
            is_standing = [tuple(sorted(each)) in self._standing for each in geoms.tolist()]
            distances_m = np.where(np.array(is_standing) & (distances_m >= 0.0), np.inf, distances_m)
        closest = int(np.argmin(distances_m))
        return float(distances_m[closest]), geoms[closest] if distances_m[closest] < np.inf else -1

    def collision(self, clearances: Clearances, index: int) -> Collision | None:
        """What touches, or comes too near, in one of the measured configurations, or None."""
        if clearances.contact_m[index] < clearances.padding_m:
            first, second = (self._clearance.name(int(geom)) for geom in clearances.contact_pair[index])
            return Collision((first, second), float(clearances.contact_m[index]))
        if clearances.organ_m[index] < ARM_MARGIN_M + clearances.padding_m:
            name = self._clearance.name(int(clearances.organ_geom[index]))
            return Collision((name, "organ"), float(clearances.organ_m[index]))
        return None

    def probe_collision(self, distance_m: float, geom: int) -> Collision | None:
        """The collision that a distance of the probe to the organ means, or None."""
        if distance_m >= PROBE_MARGIN_M:
            return None
        return Collision((self._clearance.name(geom), "organ"), float(distance_m))

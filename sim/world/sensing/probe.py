"""The probe: a reading from ray crossings cast from the tip frame that was really reached.

A ray from the tip crosses the organ and the tumours some number of times. With +1 where it leaves a surface and -1
where it enters one, the sum over the crossings beyond a point is the winding number of that surface around the point:
positive means inside, also where surfaces overlap or nest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.scene.scene import Group, Scene
from sim.world.solids.solid import Solid

EXIT_MARGIN_M = 1e-6
"""Rounding of a place: a crossing this near to the end of all surfaces is the last."""
RAY_RESTART_M = 1e-7
"""A ray goes on this far behind a hit, well above the rounding of a distance of a metre."""
MAX_CROSSINGS = 64
"""A ray that crosses more surfaces than this is caught in degenerate geometry."""
GOLDEN_ANGLE_RAD = np.pi * (3.0 - np.sqrt(5.0))
DEPTH_FRACTION = np.sqrt(3.0) - 1.0
"""Shifts the points along one ray against those of the last; not a multiple of the golden ratio, or else the depth of
a point would follow from its angle about the beam and all points would lie on one winding sheet."""


@dataclass(frozen=True, kw_only=True)
class ProbeSettings:
    """How finely a sensing action looks."""

    n_rays: int = 100
    """Rays in the cone; they pierce its base in a sunflower pattern."""
    n_points_per_ray: int = 10
    """Points on each ray, even in volume along its depth."""

    def __post_init__(self) -> None:
        """Validate the counts."""
        if self.n_rays < 1 or self.n_points_per_ray < 1:
            raise ValueError(
                f"n_rays={self.n_rays}, n_points_per_ray={self.n_points_per_ray}: at least 1 of each."
            )


@dataclass(frozen=True, eq=False)
class Reading:
    """What one sensing action returned (the paper's D_t)."""

    points_m: NDArray[np.float64]
    """Points inside both cone and organ, world frame [m], shape (N, 3)."""
    is_occupied: NDArray[np.bool_]
    """Whether each point lies in a tumour, shape (N,)."""
    T_world_probe: NDArray[np.float64]
    """Tip frame from which the rays were cast, shape (4, 4)."""
    is_target: NDArray[np.bool_] | None = None
    """Whether each point lies in a body of the second class, shape (N,); None where there is no such class."""


class Probe:
    """Casts readings in a scene."""

    def __init__(self, scene: Scene, settings: ProbeSettings | None = None) -> None:
        """Prepare the ray pattern; `scene` gives the cone and the surfaces."""
        self._model = scene.model
        self._settings = settings or ProbeSettings()
        self._cone = scene.cone
        self._tip_id = scene.model.site(scene.tip_site).id
        self._organ = _Surfaces(Group.ORGAN, [scene.anatomy.organ])
        tumours, target = scene.anatomy.tumours, scene.anatomy.target
        self._tumour = _Surfaces(Group.TUMOUR, tumours) if tumours else None
        self._target = _Surfaces(Group.TARGET, target.tumours) if target is not None else None

    def tip_pose(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """T_world_probe of the tip in this state, shape (4, 4); `data` must be forwarded."""
        T_world_probe = np.eye(4)
        T_world_probe[:3, :3] = data.site_xmat[self._tip_id].reshape(3, 3)
        T_world_probe[:3, 3] = data.site_xpos[self._tip_id]
        return T_world_probe

    def sense(self, data: mujoco.MjData, rng: np.random.Generator) -> Reading:
        """The reading at the state's tip frame.

        Args:
            data: A forwarded state of the scene.
            rng: Turns the ray pattern about the beam and shifts the points along the rays.
        """
        T_world_probe = self.tip_pose(data)
        directions_probe, ranges_m = self._pattern(rng)
        directions = directions_probe @ T_world_probe[:3, :3].T
        origin_m = T_world_probe[:3, 3].copy()
        is_in_organ = self._winding(data, origin_m, directions, ranges_m, self._organ) > 0
        is_occupied = np.zeros(ranges_m.shape, dtype=bool)
        if self._tumour is not None:
            is_occupied = self._winding(data, origin_m, directions, ranges_m, self._tumour) > 0
        is_target = None
        if self._target is not None:
            is_target = self._winding(data, origin_m, directions, ranges_m, self._target)[is_in_organ] > 0
        points_m = origin_m + ranges_m[..., None] * directions[:, None, :]
        return Reading(points_m[is_in_organ], is_occupied[is_in_organ], T_world_probe, is_target)

    def _pattern(self, rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Unit directions in the probe frame, shape (R, 3), and ranges along them [m], shape (R, K).

        Even in volume: rays pierce the base evenly in area, and depth along a ray has density z^2.
        """
        n_rays, n_points = self._settings.n_rays, self._settings.n_points_per_ray
        i = np.arange(n_rays)
        turn = GOLDEN_ANGLE_RAD * i + rng.uniform(0.0, 2.0 * np.pi)
        slope = np.tan(self._cone.half_angle_rad) * np.sqrt((i + 0.5) / n_rays)
        offset = (i * DEPTH_FRACTION + rng.uniform()) % 1.0
        share = (np.arange(n_points) + offset[:, None]) / n_points
        depth_m = self._cone.depth_m * np.cbrt(share)
        directions = np.column_stack([slope * np.cos(turn), slope * np.sin(turn), np.ones(n_rays)])
        length = np.linalg.norm(directions, axis=1)
        return directions / length[:, None], depth_m * length[:, None]

    def _winding(
        self,
        data: mujoco.MjData,
        origin_m: NDArray[np.float64],
        directions: NDArray[np.float64],
        ranges_m: NDArray[np.float64],
        surfaces: _Surfaces,
    ) -> NDArray[np.int64]:
        """Winding number of a group's surfaces about each point: the signed crossings beyond it, shape (R, K)."""
        total = np.zeros(ranges_m.shape, dtype=np.int64)
        ray, along_m, sign = self._crossings(data, origin_m, directions, surfaces)
        is_before = ranges_m[ray] < np.asarray(along_m)[:, None]
        np.add.at(total, ray, np.asarray(sign)[:, None] * is_before)
        return total

    def _crossings(
        self,
        data: mujoco.MjData,
        origin_m: NDArray[np.float64],
        directions: NDArray[np.float64],
        surfaces: _Surfaces,
    ) -> tuple[list[int], list[float], list[int]]:
        """All crossings of rays from one origin with a group's surfaces.

        Returns:
            Index of the ray, distance along it [m], and +1 where it leaves or -1 where it enters.
        """
        first_m, first_sign = self._first_crossings(data, origin_m, directions, surfaces)
        hits = np.flatnonzero(first_m >= 0.0)
        ray, along_m, sign = hits.tolist(), first_m[hits].tolist(), first_sign[hits].tolist()
        geom, normal, start_m = np.empty(1, np.int32), np.empty(3), np.empty(3)
        last_m = surfaces.ranges_at_exit_m(origin_m, directions)
        for index in hits[first_m[hits] < last_m[hits]].tolist():
            direction, travelled_m = directions[index], float(first_m[index])
            for _ in range(MAX_CROSSINGS):
                travelled_m += RAY_RESTART_M
                np.multiply(direction, travelled_m, out=start_m)
                start_m += origin_m
                step_m = mujoco.mj_ray(
                    self._model, data, start_m, direction, surfaces.group, 1, -1, geom, normal
                )
                if step_m < 0.0:
                    break
                travelled_m += step_m
                ray.append(index)
                along_m.append(travelled_m)
                sign.append(1 if normal @ direction > 0.0 else -1)
        return ray, along_m, sign

    def _first_crossings(
        self,
        data: mujoco.MjData,
        origin_m: NDArray[np.float64],
        directions: NDArray[np.float64],
        surfaces: _Surfaces,
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Distance to each ray's first crossing [m], negative where there is none, and its sign; shapes (R,)."""
        n_rays = len(directions)
        first_m, geoms, normals = np.empty(n_rays), np.empty(n_rays, np.int32), np.empty(3 * n_rays)
        mujoco.mj_multiRay(
            self._model,
            data,
            origin_m,
            directions.ravel(),
            surfaces.group,
            1,
            -1,
            geoms,
            first_m,
            normals,
            n_rays,
            np.inf,
        )
        return first_m, np.where(np.einsum("ij,ij->i", normals.reshape(-1, 3), directions) > 0.0, 1, -1)


class _Surfaces:
    """The surfaces that a group of rays asks for, and where a ray has left them all behind."""

    def __init__(self, group: Group, solids: Sequence[Solid]) -> None:
        self.group = np.zeros(mujoco.mjNGROUP, dtype=np.uint8)
        self.group[int(group)] = 1
        corners = np.array([step for step in np.ndindex(3, 3, 3) if step != (1, 1, 1)], dtype=float) - 1.0
        self._axes = corners / np.linalg.norm(corners, axis=1)[:, None]
        self._heights_m = np.max([(solid.vertices_m @ self._axes.T).max(axis=0) for solid in solids], axis=0)

    def ranges_at_exit_m(
        self, origin_m: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Where rays leave a convex body of 26 faces around the surfaces [m], shape (R,): none is crossed beyond."""
        speed = directions @ self._axes.T
        room_m = self._heights_m + EXIT_MARGIN_M - self._axes @ origin_m
        ranges_m = np.divide(room_m, speed, out=np.full(speed.shape, np.inf), where=speed > 0.0)
        return ranges_m.min(axis=1) - 2.0 * EXIT_MARGIN_M

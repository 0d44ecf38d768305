"""Rays: where they cross the surfaces of a scene, and how often the surfaces wind about the points on them.

A ray from the tip crosses the organ and the tumours some number of times. With +1 where it leaves a surface and -1
where it enters one, the sum over the crossings beyond a point is the winding number of that surface around the point:
positive means inside, also where surfaces overlap or nest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.scene.scene import Group, Scene
from sim.world.solids.solid import Solid

Surface = Literal["organ", "tumour", "target"]
"""Which bodies a ray looks for; it passes through all others."""

EXIT_MARGIN_M = 1e-6
"""Allowance for rounding: a crossing this near to where a ray leaves all surfaces behind is its last."""
RAY_RESTART_M = 1e-7
"""A ray goes on this far behind a hit, well above the rounding of a distance of a metre."""
MAX_CROSSINGS = 64
"""A ray that crosses more surfaces than this is caught in degenerate geometry, and is followed no further."""


class Crossings(NamedTuple):
    """Where rays cross surfaces, an entry per crossing, in no order along a ray."""

    ray: NDArray[np.int64]
    """Index of the ray, shape (C,)."""
    along_m: NDArray[np.float64]
    """Distance along the ray [m], shape (C,)."""
    sign: NDArray[np.int64]
    """+1 where the ray leaves a body and -1 where it enters one, shape (C,)."""


class SurfaceRays:
    """Casts rays at the organ, the tumours or the second class's bodies of a scene, at the meshes that are drawn."""

    def __init__(self, scene: Scene) -> None:
        """Prepares the surfaces of the scene.

        Args:
            scene: What the rays are cast in. A class without bodies is crossed by no ray.
        """
        anatomy = scene.anatomy
        targets = anatomy.target.tumours if anatomy.target is not None else ()
        self._model = scene.model
        self._surfaces: dict[str, _Surfaces] = {"organ": _Surfaces(Group.ORGAN, [anatomy.organ])}
        if anatomy.tumours:
            self._surfaces["tumour"] = _Surfaces(Group.TUMOUR, anatomy.tumours)
        if targets:
            self._surfaces["target"] = _Surfaces(Group.TARGET, targets)

    def winding(
        self,
        data: mujoco.MjData,
        origin_m: NDArray[np.float64],
        directions: NDArray[np.float64],
        ranges_m: NDArray[np.float64],
        *,
        of: Surface,
    ) -> NDArray[np.int64]:
        """The winding number of surfaces about points on rays from one origin: the signed crossings beyond each point.

        Args:
            data: A forwarded state of the scene.
            origin_m: Where the rays start, world frame [m], shape (3,).
            directions: Unit vectors in the world frame, shape (R, 3).
            ranges_m: Distances of the points along their rays [m], shape (R, K).
            of: Whose surfaces.

        Returns:
            Whole numbers, shape (R, K); a point lies inside where its number is above 0.

        Raises:
            ValueError: `of` names no surface.
        """
        total = np.zeros(ranges_m.shape, dtype=np.int64)
        ray, along_m, sign = self.crossings(data, origin_m, directions, of=of)
        is_before = ranges_m[ray] < along_m[:, None]
        np.add.at(total, ray, sign[:, None] * is_before)
        return total

    def crossings(
        self,
        data: mujoco.MjData,
        origin_m: NDArray[np.float64],
        directions: NDArray[np.float64],
        *,
        of: Surface,
    ) -> Crossings:
        """All crossings of rays from one origin with surfaces.

        Args:
            data: A forwarded state of the scene.
            origin_m: Where the rays start, world frame [m], shape (3,).
            directions: Unit vectors in the world frame, shape (R, 3).
            of: Whose surfaces.

        Raises:
            ValueError: `of` names no surface.
        """
        if of not in get_args(Surface):
            raise ValueError(f"of={of!r}: choose one of {', '.join(get_args(Surface))}.")
        surfaces = self._surfaces.get(of)
        if surfaces is None:
            return Crossings(np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=np.int64))
        first_m, first_sign = self._first_crossings(data, origin_m, directions, surfaces)
        hits = np.flatnonzero(first_m >= 0.0)
        ray, along_m, sign = hits.tolist(), first_m[hits].tolist(), first_sign[hits].tolist()
        last_m = surfaces.ranges_at_exit_m(origin_m, directions)
        for index in hits[first_m[hits] < last_m[hits]].tolist():
            further = self._crossings_beyond(
                data, origin_m, directions[index], float(first_m[index]), surfaces.group
            )
            ray += [index] * len(further)
            along_m += [crossing_m for crossing_m, _ in further]
            sign += [crossing_sign for _, crossing_sign in further]
        return Crossings(np.array(ray, dtype=np.int64), np.array(along_m), np.array(sign, dtype=np.int64))

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

    def _crossings_beyond(
        self,
        data: mujoco.MjData,
        origin_m: NDArray[np.float64],
        direction: NDArray[np.float64],
        travelled_m: float,
        group: NDArray[np.uint8],
    ) -> list[tuple[float, int]]:
        """Distance [m] and sign of each crossing of one ray beyond a distance."""
        found: list[tuple[float, int]] = []
        geom, normal, start_m = np.empty(1, np.int32), np.empty(3), np.empty(3)
        for _ in range(MAX_CROSSINGS):
            travelled_m += RAY_RESTART_M
            np.multiply(direction, travelled_m, out=start_m)
            start_m += origin_m
            step_m = mujoco.mj_ray(self._model, data, start_m, direction, group, 1, -1, geom, normal)
            if step_m < 0.0:
                break
            travelled_m += step_m
            found.append((travelled_m, 1 if normal @ direction > 0.0 else -1))
        return found


class _Surfaces:
    """The bodies of one geom group, and where a ray has left them all behind."""

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

"""Room for the base: where an arm's base may stand, which is neither in the table nor in the organ."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.arms.body_tree import hangs_below
from sim.world.solids.distance_grid import DistanceGrid

from .arm import ArmError
from .clearance import ARM_MARGIN_M
from .geom_shapes import GeomSurface, SphereCover
from .probe_room import MOUNT
from .scene import Scene
from .standing_contact import standing_contact

TABLE_TOLERANCE_M = 1e-3
"""A base that stands on the table may be modelled this much below its own origin."""
ENDLESS = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
"""A plane or a height field is no base."""


@dataclass(frozen=True, eq=False)
class _BaseGeom:
    """A geom of the base in the frame of the mount."""

    shape: GeomSurface | SphereCover
    at_m: NDArray[np.float64]
    """Shape (3,)."""
    R_mount_geom: NDArray[np.float64]
    """Shape (3, 3)."""


class BaseRoom:
    """The part of an arm that its joints do not move, and whether there is room for it."""

    def __init__(self, scene: Scene, organ_distance: DistanceGrid) -> None:
        """Find the base of `scene`'s arm."""
        model = scene.model
        self._grid = organ_distance
        self._geoms = _base_geoms(model)
        self._points_m = np.vstack(
            [geom.at_m + geom.shape.points_m @ geom.R_mount_geom.T for geom in self._geoms]
        )
        table = model.body("table").id
        self._boxes = [
            (model.body_pos[table] + model.geom_pos[geom], model.geom_size[geom])
            for geom in np.flatnonzero(model.geom_bodyid == table).tolist()
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX and model.geom_contype[geom]
        ]

    def obstacle(self, T_world_base: NDArray[np.float64]) -> str | None:
        """What a base with this frame, shape (4, 4), would stand in, as a phrase; None where there is room."""
        points_m = self._points_m @ T_world_base[:3, :3].T + T_world_base[:3, 3]
        for centre_m, half_m in self._boxes:
            is_within = np.abs(points_m - centre_m) < half_m - TABLE_TOLERANCE_M
            if is_within.all(axis=1).any():
                lowest_m = float(points_m[is_within[:, :2].all(axis=1), 2].min())
                return f"in the table, {(centre_m[2] + half_m[2] - lowest_m) * 1e3:.0f} mm below its top"
        distance_m = min(self._organ_distance_m(geom, T_world_base) for geom in self._geoms)
        if distance_m < ARM_MARGIN_M:
            return (
                f"in the organ, or less than {ARM_MARGIN_M * 1e3:.0f} mm from it ({distance_m * 1e3:+.0f} mm)"
            )
        return None

    def overhang_m(self, T_world_base: NDArray[np.float64]) -> float:
        """How far a base with this frame, shape (4, 4), hangs over the table's edge [m]; 0 on it or beside it."""
        points_m = self._points_m @ T_world_base[:3, :3].T + T_world_base[:3, 3]
        centre_m, half_m = max(self._boxes, key=lambda box: box[1][0] * box[1][1])
        beyond_m = np.abs(points_m[:, :2] - centre_m[:2]) - half_m[:2]
        outside_m = np.linalg.norm(np.maximum(beyond_m, 0.0), axis=1)
        is_over_table = (outside_m == 0.0).any()
        return float(outside_m.max()) if is_over_table else 0.0

    def _organ_distance_m(self, geom: _BaseGeom, T_world_base: NDArray[np.float64]) -> float:
        """How far a geom of the base is from the organ [m]; not measured further beyond the margin."""
        at_m = T_world_base[:3, :3] @ geom.at_m + T_world_base[:3, 3]
        R_world_geom = T_world_base[:3, :3] @ geom.R_mount_geom
        return float(geom.shape.distances_m(self._grid, at_m[None], R_world_geom[None], ARM_MARGIN_M)[0])


def check_base_room(scene: Scene, organ_distance: DistanceGrid) -> None:
    """Nothing, if there is room for the base where it stands, and the arm is free in some configuration.

    Raises:
        ArmError: The base stands in the table or in the organ, or something touches in every configuration.
    """
    if obstacle := BaseRoom(scene, organ_distance).obstacle(scene.T_world_base):
        x_mm, y_mm, z_mm = scene.T_world_base[:3, 3] * 1e3
        raise ArmError(
            f"The arm's base at {x_mm:.0f} {y_mm:.0f} {z_mm:.0f} mm would stand {obstacle}. Move it with `base_mm`; "
            "the table's top is z = 0."
        )
    if contact := standing_contact(scene, organ_distance):
        raise ArmError(f"The arm is nowhere free: {contact}")


def _base_geoms(model: mujoco.MjModel) -> list[_BaseGeom]:
    """The geoms that no joint moves, in the frame of the mount; an arm without any stands at its first joint."""
    data, mount = mujoco.MjData(model), model.body(MOUNT).id
    mujoco.mj_kinematics(model, data)
    R_world_mount = data.xmat[mount].reshape(3, 3)
    geoms = []
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        is_fixed = model.body_weldid[body] == 0 and hangs_below(model, body, mount)
        if is_fixed and int(model.geom_type[geom]) not in ENDLESS:
            at_m = (data.geom_xpos[geom] - data.xpos[mount]) @ R_world_mount
            R_mount_geom = R_world_mount.T @ data.geom_xmat[geom].reshape(3, 3)
            geoms.append(_BaseGeom(GeomSurface(model, geom), at_m, R_mount_geom))
    if not geoms:
        at_m = (data.xanchor[0] - data.xpos[mount]) @ R_world_mount
        point = SphereCover(np.zeros((1, 3)), np.zeros(1))
        geoms.append(_BaseGeom(point, at_m, np.eye(3)))
    return geoms

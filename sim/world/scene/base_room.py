"""Room for the base: where an arm's base may stand, which is neither in the table nor in the organ."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.arms.body_tree import hangs_below
from sim.world.solids.distance_grid import DistanceGrid

from .arm import ArmError
from .clearance import ARM_MARGIN_M, surface_points
from .probe_room import MOUNT
from .scene import Scene
from .standing_contact import standing_contact

TABLE_TOLERANCE_M = 1e-3
"""A base that stands on the table may be modelled this much below its own origin."""


class BaseRoom:
    """The part of an arm that its joints do not move, and whether there is room for it."""

    def __init__(self, scene: Scene, organ_distance: DistanceGrid) -> None:
        """Strew points over the base of `scene`'s arm."""
        model = scene.model
        self._grid = organ_distance
        self._points_m = _base_points(model)
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
        distance_m = float(self._grid.distance_m(points_m).min())
        if distance_m < ARM_MARGIN_M:
            return (
                f"in the organ, or less than {ARM_MARGIN_M * 1e3:.0f} mm from it ({distance_m * 1e3:+.0f} mm)"
            )
        return None


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


def _base_points(model: mujoco.MjModel) -> NDArray[np.float64]:
    """Points on the geoms that no joint moves, in the frame of the mount [m], shape (N, 3).

    An arm that has no such geom is taken to stand at its first joint.
    """
    data, mount = mujoco.MjData(model), model.body(MOUNT).id
    mujoco.mj_kinematics(model, data)
    points_m = []
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        is_fixed = model.body_weldid[body] == 0 and hangs_below(model, body, mount)
        if is_fixed and model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE:
            R_world_geom = data.geom_xmat[geom].reshape(3, 3)
            points_m.append(data.geom_xpos[geom] + surface_points(model, geom) @ R_world_geom.T)
    if not points_m:
        points_m.append(data.xanchor[:1])
    R_world_mount = data.xmat[mount].reshape(3, 3)
    return (np.vstack(points_m) - data.xpos[mount]) @ R_world_mount

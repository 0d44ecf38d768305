"""How far organ and arm reach in a state: points that a picture has to hold."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.scene.groups import Group
from sim.world.scene.probe_room import MOUNT, PROBE
from sim.world.scene.scene import Scene

CORNERS = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, 8).T
"""The corners of a box about its middle, shape (8, 3)."""
N_DIRECTIONS = 60
"""Directions along which the organ's farthest points are taken."""


def organ_corners_m(scene: Scene) -> NDArray[np.float64]:
    """The organ's farthest points along many directions [m, world], shape (N, 3): its hull to about a percent."""
    vertices_m = scene.anatomy.organ.vertices_m
    directions = np.random.default_rng(0).normal(size=(N_DIRECTIONS, 3))
    return vertices_m[np.unique((vertices_m @ directions.T).argmax(axis=0))]


def arm_corners_m(scene: Scene, data: mujoco.MjData) -> NDArray[np.float64]:
    """The corners of the boxes about the geoms of arm and probe that are drawn [m, world], shape (N, 3)."""
    return _corners_m(scene.model, data, (MOUNT, PROBE))


def probe_corners_m(scene: Scene, data: mujoco.MjData) -> NDArray[np.float64]:
    """The corners of the boxes about the geoms of the probe that are drawn [m, world], shape (N, 3)."""
    return _corners_m(scene.model, data, (PROBE,))


def _corners_m(model: mujoco.MjModel, data: mujoco.MjData, roots: Sequence[str]) -> NDArray[np.float64]:
    """The corners of the boxes about the drawn geoms of bodies and of all that hangs on them."""
    geoms = _drawn_geoms(model, roots)
    middle_m, half_m = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
    local_m = middle_m[:, None] + CORNERS * half_m[:, None]
    R = data.geom_xmat[geoms].reshape(-1, 3, 3)
    return (np.einsum("gij,gcj->gci", R, local_m) + data.geom_xpos[geoms][:, None]).reshape(-1, 3)


def _drawn_geoms(model: mujoco.MjModel, roots: Sequence[str]) -> NDArray[np.intp]:
    """The geoms of bodies and of all that hangs on them that a picture shows, without planes, which have no end."""
    is_carried = np.zeros(model.nbody, dtype=bool)
    for body in range(1, model.nbody):
        is_carried[body] = model.body(body).name in roots or is_carried[model.body_parentid[body]]
    is_drawn = np.isin(model.geom_group, [int(Group.SCENERY), int(Group.ARM)]) & (model.geom_rgba[:, 3] > 0)
    is_drawn &= model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE)
    return np.flatnonzero(is_drawn & is_carried[model.geom_bodyid])

"""Standing contacts: what an arm touches in every configuration, so that it can reach no pose at all."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.solids.distance_grid import DistanceGrid

from .clearance import ARM_MARGIN_M, Clearance
from .clearance_meter import ClearanceMeter
from .mounting import TABLE
from .probe_room import MOUNT
from .scene import Scene

N_FIRST, N_CONFIGURATIONS = 64, 2000
"""Configurations that are looked at: the first few leave next to nothing, and what they leave is looked at in all."""


def standing_contact(scene: Scene, organ_distance: DistanceGrid) -> str | None:
    """What the arm of a scene touches however its joints stand, and the remedy, as a sentence; None for nothing."""
    model, data = scene.model, scene.new_data()
    q = _configurations(scene)
    pairs = _always(model, data, q[:N_FIRST])
    if pairs:
        pairs &= _always(model, data, q)
    if not pairs:
        return _standing_in_organ(scene, organ_distance, q[:N_FIRST])
    still = {model.body(TABLE).id, 0}
    for pair in sorted(pairs):
        link, other = sorted(pair, key=lambda geom: int(model.geom_bodyid[geom]) in still)
        if int(model.geom_bodyid[other]) in still:
            depth_m = _least_depth_m(model, data, link, _top_m(model, data, other), q)
            return (
                f"{_name(model, link)} stands in the {_name(model, other)} in every configuration. Raise the base by "
                f"at least {math.ceil(depth_m * 1e3 - 1e-6):.0f} mm (`base_mm`); the table's top is z = 0."
            )
    first, second = (_name(model, geom) for geom in min(pairs))
    return (
        f"{first} and {second} overlap in every configuration. If they may, add an <exclude> of their bodies to the "
        "<contact> of the arm's file; otherwise mend their shapes or the base's place (`base_mm`)."
    )


def _standing_in_organ(scene: Scene, organ_distance: DistanceGrid, q: NDArray[np.float64]) -> str | None:
    """What of the arm is too near to the organ in all of some configurations, as a sentence."""
    clearance = Clearance(scene, organ_distance)
    measured = ClearanceMeter(scene, clearance).measure(q)
    if (measured.organ_m >= ARM_MARGIN_M).any():
        return None
    name = clearance.name(int(measured.organ_geom[np.argmin(measured.organ_m)])).removeprefix("arm_")
    return (
        f"{name}, or another link, is in the organ in every configuration, or less than {ARM_MARGIN_M * 1e3:.0f} mm "
        "from it. Move the base away from the organ (`base_mm`)."
    )


def _configurations(scene: Scene) -> NDArray[np.float64]:
    """Home, and positions of all joints drawn within their limits; half a turn about home where there are none."""
    model, rng = scene.model, np.random.default_rng(0)
    is_limited = model.jnt_limited.astype(bool)
    low = np.where(is_limited, model.jnt_range[:, 0], scene.home_q - np.pi)
    high = np.where(is_limited, model.jnt_range[:, 1], scene.home_q + np.pi)
    q = scene.home_q + np.zeros((N_CONFIGURATIONS, 1))
    q[1:] = low + rng.uniform(size=(N_CONFIGURATIONS - 1, len(low))) * (high - low)
    return q


def _always(model: mujoco.MjModel, data: mujoco.MjData, q: NDArray[np.float64]) -> set[tuple[int, int]]:
    """Pairs of geoms that overlap in each of some configurations."""
    always: set[tuple[int, int]] | None = None
    for each in q:
        data.qpos[:] = each
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        contact = data.contact
        pairs = contact.geom[contact.dist < 0.0].tolist() if data.ncon else []
        found = {(min(pair), max(pair)) for pair in pairs}
        always = found if always is None else always & found
        if not always:
            return set()
    return always or set()


def _least_depth_m(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, top_m: float, q: NDArray[np.float64]
) -> float:
    """How far a geom reaches below a height at least, in some configurations [m]."""
    depth_m = np.inf
    for each in q:
        data.qpos[:] = each
        mujoco.mj_kinematics(model, data)
        depth_m = min(depth_m, top_m - _lowest_m(model, data, geom))
    return depth_m


def _top_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """The height of the top of the table, or of the floor [m]."""
    is_plane = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
    return float(data.geom_xpos[geom, 2]) if is_plane else 0.0


def _lowest_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """The height of the lowest point of a geom [m]."""
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    down = data.geom_xmat[geom].reshape(3, 3)[2]
    if model.geom_dataid[geom] >= 0:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        below_m = -float((model.mesh_vert[first : first + count] @ down).min())
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        below_m = float(np.abs(down) @ size)
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        below_m = float(np.linalg.norm(down * size))
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        below_m = float(abs(down[2]) * size[1] + np.hypot(down[0], down[1]) * size[0])
    else:
        below_m = float(size[0] + (abs(down[2]) * size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0))
    return float(data.geom_xpos[geom, 2]) - below_m


def _name(model: mujoco.MjModel, geom: int) -> str:
    """What a geom, or its body where it has no name, is called in its file."""
    body = model.body(int(model.geom_bodyid[geom])).name
    name = model.geom(geom).name or ("world of the arm's file" if body == MOUNT else body)
    return name.removeprefix("arm_").removeprefix("probe_")

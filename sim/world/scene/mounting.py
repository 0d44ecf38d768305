"""Mounting: the arm is put on its base and the probe on its flange, and what touches by nature is excluded."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.arms.errors import ArmError
from sim.world.arms.mujoco_messages import MUJOCO_ERRORS, caught_warnings, whole_message
from sim.world.probes.probe import EMBEDDED, ProbeModel

from .arm import MODELS_DIR, ArmModel
from .groups import Group
from .probe_room import MOUNT, PROBE, ProbeRoom, colliding_geoms

TABLE, TIP_SITE = "table", "probe_tip"
FLUSH_M = 1e-3
"""A first link that stands on the table, or on what the file's world holds, may be modelled this much into it [m]."""


@dataclass(frozen=True, eq=False)
class Mounted:
    """What carries the probe in a scene that is not compiled yet."""

    home_q: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """Joint positions at rest, shape (n_joints,); empty for a probe that no arm carries."""
    path: Path | None = None
    """The arm's file; None for a probe that no arm carries."""
    notices: tuple[str, ...] = ()
    """What is unusual about arm and probe."""


def mount(spec: mujoco.MjSpec, arm: ArmModel | None, model: ProbeModel = EMBEDDED) -> Mounted:
    """Put the probe into a scene, on an arm or flying freely.

    Args:
        spec: The scene.
        arm: The arm; None for a probe that flies freely.
        model: The probe.

    Raises:
        ArmError: The arm cannot be used; see `ArmModel.load`.
        ProbeError: The probe cannot be used; see `ProbeModel.load`.
    """
    rigid = model.load()
    if rigid is None:
        probe, remarks = mujoco.MjSpec.from_file(str(MODELS_DIR / "probe.xml")), ()
    else:
        probe, remarks = mujoco.MjSpec.from_string(rigid.mjcf()), rigid.notices
    if arm is None:
        probe.body("probe").mocap = True
        spec.attach(probe, prefix="probe_", frame=spec.worldbody.add_frame())
        return Mounted(notices=remarks)
    loaded = arm.load()
    # Rays choose what they meet by these groups.
    for geom in loaded.spec.geoms:
        if geom.group in (Group.ORGAN, Group.TUMOUR, Group.TARGET):
            geom.group = int(Group.ARM)
    T_world_base = arm.T_world_base
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(T_world_base[:3, :3]).ravel())
    base = spec.worldbody.add_body(name=MOUNT, pos=T_world_base[:3, 3], quat=quat)
    spec.option.integrator = loaded.spec.option.integrator
    spec.option.timestep = loaded.spec.option.timestep
    # Of all other options the scene's own hold, and MuJoCo's warnings that they differ from the file's say no more.
    with caught_warnings():
        spec.attach(loaded.spec, prefix="arm_", frame=base.add_frame())
        spec.attach(probe, prefix="probe_", site=spec.site(f"arm_{loaded.flange}"))
    _exclude_neighbours(spec, f"arm_{loaded.flange}")
    return Mounted(loaded.home_q, arm.path, (*loaded.notices, *remarks))


def compile_mounted(spec: mujoco.MjSpec, mounted: Mounted) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    """The model of a whole scene, and what is unusual about its arm.

    Raises:
        ArmError: MuJoCo cannot compile it, or the probe stands in its neighbours, whatever the arm does.
    """
    if mounted.path is None:
        return spec.compile(), mounted.notices
    model = _compiled(spec, mounted.path)
    room = ProbeRoom(model, mounted.home_q, TIP_SITE)
    direction = room.direction()
    if obstacle := room.obstacle():
        raise ArmError(
            f"{mounted.path}: {obstacle}{'; ' + direction if direction else ''}. Turn the flange, name another with "
            "`flange`, or remove what is in the probe's way from the file."
        )
    pairs, stands_on = room.contacts(), _supports(model, mounted.home_q)
    for pair in pairs:
        names = [_named_geom(spec, geom) for geom in pair]
        # Contacts that are named in pairs are found where MuJoCo leaves out neighbours otherwise.
        spec.add_pair(geomname1=names[0], geomname2=names[1])
    for first, second in stands_on:
        spec.add_exclude(bodyname1=model.body(first).name, bodyname2=model.body(second).name)
    if pairs or stands_on:
        model = _compiled(spec, mounted.path)
    return model, (*mounted.notices, *_notice(mounted.path, direction))


def _notice(path: Path, direction: str | None) -> tuple[str, ...]:
    if direction is None:
        return ()
    return (
        f"{path.name}: {direction}, and the probe presses along it. If that is not meant, turn the flange, or name "
        "another with `flange`.",
    )


def _compiled(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    try:
        with caught_warnings():
            return spec.compile()
    except MUJOCO_ERRORS as error:
        raise ArmError(f"{path}: MuJoCo cannot put this arm into a scene: {whole_message(error)}.") from error


def _exclude_neighbours(spec: mujoco.MjSpec, flange: str) -> None:
    """Exclude contacts that neighbours always have: the probe with the last two links, a fixed base with link 1."""
    last = spec.site(flange).parent
    spec.add_exclude(bodyname1=PROBE, bodyname2=last.name)
    if last.parent.name != "world":
        spec.add_exclude(bodyname1=PROBE, bodyname2=last.parent.name)
    # MuJoCo itself excludes links that share a joint, but not where the first of them is fixed.
    for body in spec.bodies:
        is_link = body.name.startswith("arm_") and body.parent.name.startswith("arm_")
        if is_link and body.joints and _is_fixed(body.parent):
            spec.add_exclude(bodyname1=body.parent.name, bodyname2=body.name)


def _is_fixed(body: mujoco.MjsBody) -> bool:
    """Whether no joint moves a body."""
    while body.name != MOUNT:
        if body.joints:
            return False
        body = body.parent
    return True


def _supports(model: mujoco.MjModel, home_q: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pairs of a body that stands still and a first moving link that at home rests on it and no more, as a turret does.

    The bodies that stand still are the table, and what the arm's file has in its world.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = home_q
    mujoco.mj_kinematics(model, data)
    still = (model.body(TABLE).id, model.body(MOUNT).id)
    rests: dict[tuple[int, int], float] = {}
    for geom in colliding_geoms(model):
        link = int(model.geom_bodyid[geom])
        if link == 0 or model.body_weldid[link] == 0 or model.body_weldid[model.body_parentid[link]] != 0:
            continue
        for other in np.flatnonzero(np.isin(model.geom_bodyid, still) & (model.geom_contype != 0)).tolist():
            apart_m = mujoco.mj_geomDistance(model, data, geom, other, 1.0, None)
            pair = (int(model.geom_bodyid[other]), link)
            rests[pair] = min(rests.get(pair, np.inf), apart_m)
    return [
        pair
        for pair, apart_m in rests.items()
        if apart_m < FLUSH_M and (apart_m > -FLUSH_M or pair[0] != still[0])
    ]


def _named_geom(spec: mujoco.MjSpec, geom: int) -> str:
    """The name of a compiled spec's geom; one without a name is given one."""
    found = next(each for each in spec.geoms if each.id == geom)
    found.name = found.name or f"{found.parent.name}_{geom}"
    return found.name

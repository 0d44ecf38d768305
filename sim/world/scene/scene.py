"""The scene: arm, probe, table, organ, tumours, targets and cone composed into one MuJoCo model."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import mujoco
import numpy as np
from numpy.typing import NDArray

from planner import Cone
from sim.world.anatomy.anatomy import Anatomy
from sim.world.frames import quaternion_matrix
from sim.world.solids.solid import Solid

from .arm import MODELS_DIR, ArmError, ArmModel
from .probe_room import MOUNT, ProbeRoom

ORGAN_RGBA = (0.72, 0.28, 0.24, 0.30)
TUMOUR_RGBA = (0.98, 0.78, 0.10, 1.0)
TARGET_RGBA = (0.94, 0.80, 0.94, 1.0)
STRUCTURE_RGBA = (0.30, 0.42, 0.62, 0.85)
KEEPOUT_RGBA = (0.16, 0.45, 0.30, 0.95)
CONE_RGBA = (0.56, 0.36, 0.85, 0.28)
MIN_MESH_EXTENT_M = 1e-4
"""Tumours thinner than this have no volume that MuJoCo could integrate."""


class Group(IntEnum):
    """Geom groups, by which a ray or a picture chooses what it meets or shows. MuJoCo has these six and no more."""

    SCENERY = 0
    """Table and structures: what is only shown."""
    TARGET = 1
    ARM = 2
    ARM_COLLISION = 3
    ORGAN = 4
    TUMOUR = 5


@dataclass(frozen=True, eq=False)
class Scene:
    """A compiled world. `model` is shared; every user makes its own `MjData`."""

    model: mujoco.MjModel
    anatomy: Anatomy
    cone: Cone
    home_q: NDArray[np.float64]
    """Joint positions at rest, shape (n_joints,); empty for a free-flying probe."""
    tip_site: str = "probe_tip"
    free_probe: bool = False
    """True where no arm carries the probe: its body is then a mocap body."""
    arm_geoms: frozenset[int] = field(default_factory=frozenset)
    """Geom ids of arm and probe that can collide."""
    notices: tuple[str, ...] = ()
    """What is unusual about the arm."""

    @property
    def T_world_base(self) -> NDArray[np.float64]:
        """Where the arm's base stands, shape (4, 4); the world's origin for a free probe."""
        T = np.eye(4)
        if not self.free_probe:
            mount = self.model.body(MOUNT)
            T[:3, :3], T[:3, 3] = quaternion_matrix(mount.quat), mount.pos
        return T

    def new_data(self) -> mujoco.MjData:
        """A fresh state with the arm at home."""
        data = mujoco.MjData(self.model)
        if self.home_q.size:
            data.qpos[: self.home_q.size] = self.home_q
        mujoco.mj_forward(self.model, data)
        return data


def build_scene(anatomy: Anatomy, cone: Cone, *, arm: ArmModel | None) -> Scene:
    """Compose the world.

    Args:
        anatomy: Organ, tumours and targets in world coordinates [m].
        cone: The sensed volume; drawn as a translucent cone at the probe's tip.
        arm: The arm and where it stands, or None for a probe that flies freely.

    Raises:
        ArmError: The arm cannot be used; see `ArmModel.load`.
    """
    spec = mujoco.MjSpec.from_file(str(MODELS_DIR / "table.xml"))
    spec.modelname = "sounding"
    spec.visual.map.znear = 0.01
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1440
    # On a software renderer several samples per pixel double the time of a picture; frames smooth edges later.
    spec.visual.quality.offsamples = 0
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 20, 12
    spec.visual.headlight.ambient = [0.38, 0.38, 0.38]
    spec.visual.headlight.diffuse = [0.30, 0.30, 0.30]
    probe = mujoco.MjSpec.from_file(str(MODELS_DIR / "probe.xml"))
    home_q = _attach(spec, probe, arm)
    _add_solid(spec, "organ", anatomy.organ, ORGAN_RGBA, Group.ORGAN)
    for index, tumour in enumerate(anatomy.tumours):
        _add_solid(spec, f"tumour{index}", tumour, TUMOUR_RGBA, Group.TUMOUR)
    for index, structure in enumerate(anatomy.structures):
        rgba = KEEPOUT_RGBA if structure.is_keepout else STRUCTURE_RGBA
        _add_solid(spec, f"structure{index}", structure.solid, rgba, Group.SCENERY, is_shell=True)
    for index, target in enumerate(anatomy.target.tumours if anatomy.target else ()):
        _add_solid(spec, f"target{index}", target, TARGET_RGBA, Group.TARGET)
    _add_cone(spec, cone)
    model, notices = spec.compile(), ()
    if arm is not None:
        model, notices = _with_probe_mounted(spec, model, home_q, arm)
    return Scene(
        model=model,
        anatomy=anatomy,
        cone=cone,
        home_q=home_q,
        free_probe=arm is None,
        arm_geoms=_collision_geoms(model),
        notices=notices,
    )


def _attach(spec: mujoco.MjSpec, probe: mujoco.MjSpec, arm: ArmModel | None) -> NDArray[np.float64]:
    """The home configuration of the arm, which is attached with the probe at its flange; empty for a mocap probe."""
    if arm is None:
        probe.body("probe").mocap = True
        spec.attach(probe, prefix="probe_", frame=spec.worldbody.add_frame())
        return np.empty(0)
    arm_spec, home_q = arm.load()
    # Rays choose what they meet by these groups.
    for geom in arm_spec.geoms:
        if geom.group in (Group.ORGAN, Group.TUMOUR, Group.TARGET):
            geom.group = int(Group.ARM)
    T_world_base = arm.T_world_base
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(T_world_base[:3, :3]).ravel())
    mount = spec.worldbody.add_body(name=MOUNT, pos=T_world_base[:3, 3], quat=quat)
    flange = arm.flange_of(arm_spec)
    spec.option.integrator = arm_spec.option.integrator
    spec.option.timestep = arm_spec.option.timestep
    spec.attach(arm_spec, prefix="arm_", frame=mount.add_frame())
    spec.attach(probe, prefix="probe_", site=spec.site(f"arm_{flange}"))
    _exclude_neighbours(spec, f"arm_{flange}")
    return home_q


def _exclude_neighbours(spec: mujoco.MjSpec, flange: str) -> None:
    """Exclude contacts that rigid neighbours always have: probe with the last two links, base with table."""
    last = spec.site(flange).parent
    spec.add_exclude(bodyname1="probe_probe", bodyname2=last.name)
    above = last.parent
    if above is not None and above.name not in ("world", ""):
        spec.add_exclude(bodyname1="probe_probe", bodyname2=above.name)
    base = next((body for body in spec.bodies if body.name.startswith("arm_")), None)
    if base is not None:
        spec.add_exclude(bodyname1="table", bodyname2=base.name)
    # MuJoCo itself excludes links that share a joint, but not where the first of them is fixed.
    for body in spec.bodies:
        parent = body.parent
        is_link = body.name.startswith("arm_") and parent.name.startswith("arm_")
        if is_link and body.joints and _is_fixed(parent):
            spec.add_exclude(bodyname1=parent.name, bodyname2=body.name)


def _with_probe_mounted(
    spec: mujoco.MjSpec, model: mujoco.MjModel, home_q: NDArray[np.float64], arm: ArmModel
) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    """The model with contacts between the probe and the link before it where they can meet, and what is to be said.

    Raises:
        ArmError: The probe stands in its neighbours, whatever the arm does.
    """
    room = ProbeRoom(model, home_q, "probe_tip")
    direction = room.direction()
    if obstacle := room.obstacle():
        raise ArmError(
            f"{arm.path}: {obstacle}{'; ' + direction if direction else ''}. Turn the flange, name another with "
            "`flange`, or remove what is in the probe's way from the file."
        )
    said = f"{arm.path.name}: {direction}, and the probe presses along it. If that is not meant, turn the flange, or "
    notices = (said + "name another with `flange`.",) if direction else ()
    pairs = room.contacts()
    for pair in pairs:
        names = [_named_geom(spec, geom) for geom in pair]
        # Contacts that are named in pairs are found where MuJoCo leaves out neighbours otherwise.
        spec.add_pair(geomname1=names[0], geomname2=names[1])
    return (spec.compile() if pairs else model), notices


def _named_geom(spec: mujoco.MjSpec, geom: int) -> str:
    """The name of a compiled spec's geom; one without a name is given one."""
    found = next(each for each in spec.geoms if each.id == geom)
    found.name = found.name or f"{found.parent.name}_{geom}"
    return found.name


def _is_fixed(body: mujoco.MjsBody) -> bool:
    """Whether no joint moves a body."""
    while body.name != MOUNT:
        if body.joints:
            return False
        body = body.parent
    return True


def _add_solid(
    spec: mujoco.MjSpec,
    name: str,
    solid: Solid,
    rgba: tuple[float, float, float, float],
    group: Group,
    *,
    is_shell: bool = False,
) -> None:
    """Add a mesh, seen by rays and the camera; contacts with it are decided on its true surface.

    A shell need not be closed.
    """
    mesh = spec.add_mesh(name=name, uservert=solid.vertices_m.ravel(), userface=solid.faces.ravel())
    if is_shell:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        rgba=rgba,
        group=int(group),
        contype=0,
        conaffinity=0,
        mass=0.0,
    )


def _add_cone(spec: mujoco.MjSpec, cone: Cone, n_sides: int = 48) -> None:
    """Add the cone at the tip as a mesh site: sites are drawn, and rays never hit them."""
    turn = np.linspace(0.0, 2.0 * np.pi, n_sides, endpoint=False)
    radius_m = cone.depth_m * np.tan(cone.half_angle_rad)
    rim = np.column_stack([radius_m * np.cos(turn), radius_m * np.sin(turn), np.full(n_sides, cone.depth_m)])
    vertices_m = np.vstack([[0.0, 0.0, 0.0], [0.0, 0.0, cone.depth_m], rim])
    i, j = np.arange(n_sides) + 2, (np.arange(n_sides) + 1) % n_sides + 2
    side, base = np.column_stack([0 * i, j, i]), np.column_stack([0 * i + 1, i, j])
    spec.add_mesh(name="cone", uservert=vertices_m.ravel(), userface=np.vstack([side, base]).ravel())
    tip = spec.site("probe_tip")
    tip.parent.add_site(
        name="cone",
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname="cone",
        pos=tip.pos,
        quat=tip.quat,
        rgba=CONE_RGBA,
        group=0,
    )


def _collision_geoms(model: mujoco.MjModel) -> frozenset[int]:
    """Ids of the geoms of arm and probe that take part in collisions."""
    return frozenset(
        i
        for i in range(model.ngeom)
        if model.body(model.geom_bodyid[i]).name.startswith(("arm_", "probe_"))
        and (model.geom_contype[i] or model.geom_conaffinity[i])
    )

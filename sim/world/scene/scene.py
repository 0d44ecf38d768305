"""The scene: arm, probe, table, organ, tumours, targets and cone composed into one MuJoCo model."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from planner import Cone
from sim.colours import KEEPOUT, ORGAN, PROBE, STRUCTURE, TARGET, TRUTH, rgba
from sim.world.anatomy.anatomy import Anatomy
from sim.world.arms.mujoco_messages import caught_warnings
from sim.world.frames import quaternion_matrix
from sim.world.probes.probe import EMBEDDED, ProbeModel
from sim.world.solids.solid import Solid

from .arm import MODELS_DIR, ArmModel
from .groups import Group
from .mounting import TIP_SITE, compile_mounted, mount
from .probe_room import MOUNT, colliding_geoms

ORGAN_RGBA = rgba(ORGAN, 0.34)
TUMOUR_RGBA = rgba(TRUTH, 0.6)
TARGET_RGBA = rgba(TARGET, 0.6)
STRUCTURE_RGBA = rgba(STRUCTURE, 0.85)
KEEPOUT_RGBA = rgba(KEEPOUT, 0.95)
CONE_RGBA = rgba(PROBE, 0.28)
MIN_MESH_EXTENT_M = 1e-4
"""Tumours thinner than this have no volume that MuJoCo could integrate."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A compiled world. `model` is shared; every user makes its own `MjData`."""

    model: mujoco.MjModel
    anatomy: Anatomy
    cone: Cone
    home_q: NDArray[np.float64]
    """Joint positions at rest, shape (n_joints,); empty for a free-flying probe."""
    tip_site: str = TIP_SITE
    has_own_probe: bool = False
    """Whether the probe is a user's, and not the embedded one."""
    free_probe: bool = False
    """True where no arm carries the probe: its body is then a mocap body."""
    arm_geoms: frozenset[int] = field(default_factory=frozenset)
    """Geom ids of arm and probe that can collide."""
    notices: tuple[str, ...] = ()
    """What is unusual about arm and probe."""

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
        # What MuJoCo warns of was told when the arm was loaded.
        with caught_warnings():
            mujoco.mj_forward(self.model, data)
        return data


def build_scene(anatomy: Anatomy, cone: Cone, *, arm: ArmModel | None, probe: ProbeModel = EMBEDDED) -> Scene:
    """Compose the world.

    Args:
        anatomy: Organ, tumours and targets in world coordinates [m].
        cone: The sensed volume; drawn as a translucent cone at the probe's tip.
        arm: The arm and where it stands, or None for a probe that flies freely.
        probe: The probe.

    Raises:
        ArmError: The arm cannot be used; see `ArmModel.load`.
        ProbeError: The probe cannot be used; see `ProbeModel.load`.
    """
    spec = mujoco.MjSpec.from_file(str(MODELS_DIR / "table.xml"))
    spec.modelname = "sounding"
    spec.visual.map.znear = 0.01
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1440
    # Frames have several samples per pixel by themselves, which takes less time.
    spec.visual.quality.offsamples = 0
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 20, 12
    spec.visual.headlight.ambient = [0.38, 0.38, 0.38]
    spec.visual.headlight.diffuse = [0.30, 0.30, 0.30]
    mounted = mount(spec, arm, probe)
    _add_solid(spec, "organ", anatomy.organ, ORGAN_RGBA, Group.ORGAN)
    for index, tumour in enumerate(anatomy.tumours):
        _add_solid(spec, f"tumour{index}", tumour, TUMOUR_RGBA, Group.TUMOUR)
    for index, structure in enumerate(anatomy.structures):
        rgba = KEEPOUT_RGBA if structure.is_keepout else STRUCTURE_RGBA
        _add_solid(spec, f"structure{index}", structure.solid, rgba, Group.SCENERY, is_shell=True)
    for index, target in enumerate(anatomy.target.tumours if anatomy.target else ()):
        _add_solid(spec, f"target{index}", target, TARGET_RGBA, Group.TARGET)
    _add_cone(spec, cone)
    model, notices = compile_mounted(spec, mounted)
    return Scene(
        model=model,
        anatomy=anatomy,
        cone=cone,
        home_q=mounted.home_q,
        has_own_probe=not probe.is_embedded,
        free_probe=arm is None,
        arm_geoms=frozenset(colliding_geoms(model)),
        notices=notices,
    )


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

"""Positioners bring the probe to a pose: an arm that must reach it, or no arm at all (the paper's assumption)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from planner import Workspace
from sim.world.frames import frames_along, quaternion_matrix
from sim.world.ik.damped_least_squares import descend
from sim.world.ik.kinematics import Kinematics
from sim.world.ik.result import IkResult, IkStatus
from sim.world.ik.settings import IkSettings
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import Scene
from sim.world.solids.distance_grid import DistanceGrid

SHIFT_TOLERANCE_M, SHIFT_TOLERANCE_RAD = 1e-4, 2e-3
"""A tip is shifted to within this of where it shall be, as the inverse kinematics brings it to a pose."""


class Positioner(ABC):
    """What brings the probe to the poses of one workspace."""

    joint_names: tuple[str, ...] = ()
    """Names of the joints, with their unit, in the order of `IkResult.q`; empty for a free-flying probe."""
    workspace: Workspace
    """The poses."""

    @abstractmethod
    def reach(self, pose: int) -> IkResult:
        """Whether and how pose `pose` of the workspace is reached; the same answer every time."""

    def is_prepared(self, pose: int) -> bool:
        """Whether `reach` answers at once, as it does unless a positioner says otherwise."""
        del pose
        return True

    def prepare(self, poses: Sequence[int]) -> None:  # noqa: B027, most positioners have nothing to prepare
        """Find the answers for poses together, which is faster than one after the other; they are the same."""

    @abstractmethod
    def place(self, data: mujoco.MjData, pose: int, *, is_lifted: bool) -> None:
        """Bring a state to a reached pose, or to the stand-off above it; kinematics are up to date afterwards."""

    @abstractmethod
    def shift(self, data: mujoco.MjData, T_world_tip: NDArray[np.float64]) -> str:
        """Bring the tip of a state to a place near where it is, with the turn about the beam left free.

        Args:
            data: A state; it is as it was where the place is not reached.
            T_world_tip: Where the tip shall be, shape (4, 4).

        Returns:
            Why the place is not reached, as a sentence; empty where it is.
        """


class ArmPositioner(Positioner):
    """The scene's arm, which reaches poses by inverse kinematics. Answers are kept, so a pose is solved only once."""

    def __init__(
        self,
        scene: Scene,
        workspace: Workspace,
        organ_distance: DistanceGrid,
        settings: IkSettings | None = None,
    ) -> None:
        """Prepare the kinematics of the scene's arm; `organ_distance` is the organ's signed distance grid."""
        self.workspace = workspace
        self._kinematics = Kinematics(scene, Clearance(scene, organ_distance), settings)
        self._answers: dict[int, IkResult] = {}
        self.search = self._kinematics.search
        """The inverse kinematics that answers, which a path search builds on."""
        model = scene.model
        self.joint_names = tuple(_joint_column(model, i) for i in range(model.njnt))

    def reach(self, pose: int) -> IkResult:
        """See `Positioner.reach`."""
        if pose not in self._answers:
            position_m, normal = self.workspace.positions_m[pose], self.workspace.normals[pose]
            self._answers[pose] = self._kinematics.solve(position_m, normal)
        return self._answers[pose]

    def is_prepared(self, pose: int) -> bool:
        """See `Positioner.is_prepared`."""
        return pose in self._answers

    def prepare(self, poses: Sequence[int]) -> None:
        """See `Positioner.prepare`."""
        new = [pose for pose in dict.fromkeys(poses) if pose not in self._answers]
        answers = self._kinematics.solve_many(self.workspace.positions_m[new], self.workspace.normals[new])
        self._answers.update(zip(new, answers, strict=True))

    def place(self, data: mujoco.MjData, pose: int, *, is_lifted: bool) -> None:
        """See `Positioner.place`."""
        answer = self.reach(pose)
        data.qpos[:] = answer.q_standoff if is_lifted else answer.q
        mujoco.mj_fwdPosition(data.model, data)

    def shift(self, data: mujoco.MjData, T_world_tip: NDArray[np.float64]) -> str:
        """See `Positioner.shift`; joints move as little as they can, and nothing touches the table or the arm."""
        chain, before = self.search.chain, data.qpos.copy()
        found = descend(
            chain,
            before[None, chain.columns],
            T_world_tip[None, :3, 3],
            T_world_tip[None, :3, 2],
            position_tolerance_m=SHIFT_TOLERANCE_M,
            angle_tolerance_rad=SHIFT_TOLERANCE_RAD,
            centring_gain=0.0,
        )
        if found.distance_m[0] > SHIFT_TOLERANCE_M or found.angle_rad[0] > SHIFT_TOLERANCE_RAD:
            return "The arm's joints end before it has brought the probe to where the organ lies."
        data.qpos[chain.columns] = found.q[0]
        mujoco.mj_fwdPosition(data.model, data)
        touched = touching(data)
        if touched:
            data.qpos[:] = before
            mujoco.mj_fwdPosition(data.model, data)
        return touched


class FreePositioner(Positioner):
    """A probe that flies to wherever it is sent."""

    def __init__(self, scene: Scene, workspace: Workspace, settings: IkSettings | None = None) -> None:
        """Remember the scene's mocap probe and the workspace."""
        self.workspace = workspace
        self._standoff_m = (settings or IkSettings()).standoff_m
        tip = scene.model.site(scene.tip_site)
        self._tip_in_body_m = scene.model.site_pos[tip.id].copy()
        self._R_tip_body = quaternion_matrix(scene.model.site_quat[tip.id]).T

    def reach(self, pose: int) -> IkResult:
        """See `Positioner.reach`: always reached, without error."""
        nothing = np.empty(0)
        return IkResult(IkStatus.REACHED, nothing, nothing, 0.0, 0.0, 0, 0)

    def place(self, data: mujoco.MjData, pose: int, *, is_lifted: bool) -> None:
        """See `Positioner.place`."""
        normal = self.workspace.normals[pose]
        tip_m = self.workspace.positions_m[pose] - (self._standoff_m if is_lifted else 0.0) * normal
        self._put(data, tip_m, frames_along(normal[None])[0])

    def shift(self, data: mujoco.MjData, T_world_tip: NDArray[np.float64]) -> str:
        """See `Positioner.shift`: always reached."""
        self._put(data, T_world_tip[:3, 3], T_world_tip[:3, :3])
        return ""

    def _put(self, data: mujoco.MjData, tip_m: NDArray[np.float64], R_world_tip: NDArray[np.float64]) -> None:
        R_world_body = R_world_tip @ self._R_tip_body
        data.mocap_pos[0] = tip_m - R_world_body @ self._tip_in_body_m
        mujoco.mju_mat2Quat(data.mocap_quat[0], R_world_body.ravel())
        mujoco.mj_fwdPosition(data.model, data)


def touching(data: mujoco.MjData) -> str:
    """What of arm, probe and table touch in a state, as a sentence; empty where nothing does."""
    mujoco.mj_collision(data.model, data)
    if not data.ncon:
        return ""
    worst = min(data.contact[: data.ncon], key=lambda contact: contact.dist)
    if worst.dist >= 0.0:
        return ""
    names = [data.model.geom(geom).name or f"geom {geom}" for geom in (worst.geom1, worst.geom2)]
    return f"On the way to where the organ lies, {names[0]} would touch {names[1]}."


def _joint_column(model: mujoco.MjModel, joint: int) -> str:
    name = model.joint(joint).name.removeprefix("arm_") or f"joint{joint + 1}"
    return f"{name}_m" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else f"{name}_rad"

"""Positioners bring the probe to a pose: an arm that must reach it, or no arm at all (the paper's assumption)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import mujoco
import numpy as np

from planner import Workspace
from sim.world.frames import frames_along, quaternion_matrix
from sim.world.ik.kinematics import Kinematics
from sim.world.ik.result import IkResult, IkStatus
from sim.world.ik.settings import IkSettings
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import Scene
from sim.world.solids.distance_grid import DistanceGrid


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
        R_world_body = frames_along(normal[None])[0] @ self._R_tip_body
        tip_m = self.workspace.positions_m[pose] - (self._standoff_m if is_lifted else 0.0) * normal
        data.mocap_pos[0] = tip_m - R_world_body @ self._tip_in_body_m
        mujoco.mju_mat2Quat(data.mocap_quat[0], R_world_body.ravel())
        mujoco.mj_fwdPosition(data.model, data)


def _joint_column(model: mujoco.MjModel, joint: int) -> str:
    name = model.joint(joint).name.removeprefix("arm_") or f"joint{joint + 1}"
    return f"{name}_m" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else f"{name}_rad"

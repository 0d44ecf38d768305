"""Motion: how the probe gets from one sensing pose to the next, and how long that takes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import mujoco
import numpy as np
from numpy.typing import NDArray

from planner import Planner, Situation
from sim.world.errors import WorldError
from sim.world.ik.settings import IkSettings

from ..positioner import Positioner
from .held_force import HeldForce, held_together
from .travel import Travel


class Phase(IntEnum):
    """What the probe is doing."""

    LIFT = 0
    TRANSFER = 1
    DESCEND = 2
    HOLD = 3
    SWEEP = 4


@dataclass(frozen=True)
class SkippedPose:
    """A pose that the planner wanted and the probe could not take."""

    pose_index: int
    reason: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """The way to one pose: T states in time, or the reason why the probe did not get there."""

    time_s: NDArray[np.float64]
    """Time since the motion began, increasing from 0 [s], shape (T,)."""
    states: NDArray[np.float64]
    """Joint positions of the scene [rad or m], shape (T, nq); of a free probe its body's position and wxyz
    quaternion, shape (T, 7)."""
    tips_m: NDArray[np.float64]
    """Where the tip was [m], shape (T, 3)."""
    phases: NDArray[np.int8]
    """The `Phase` of each state, shape (T,)."""
    joint_travel_rad: float | None
    """Sum of the ways of all turning joints; None for a free probe."""
    tracking_error_m: float | None = None
    """Distance of the tip from where it was sent, at the time of sensing; None where the motion is not simulated."""
    tracking_error_rad: float | None = None
    """Angle between the beam and where it was sent, likewise."""
    contact_force_n: float | None = None
    """Force of the probe on the organ at the time of sensing; None where there is no contact model."""
    force_error_n: float | None = None
    """By how much that force is above the one that was wanted; None where the probe is sent to a depth."""
    peak_force_n: float | None = None
    """Largest contact force of the motion; None where there is no contact model."""
    held: HeldForce | None = None
    """The force while the probe slid; None where no force is held."""
    reason: str = ""
    """Why the pose was not reached; empty if it was. Where there are states too, the arm moved and missed it."""
    passed: tuple[int, ...] = ()
    """The poses at, or next to, which readings are taken on the way, in order; none where one is taken at its end."""
    passed_rows: tuple[int, ...] = ()
    """The rows of the states in which they are taken."""

    @property
    def is_done(self) -> bool:
        """Whether the probe got there."""
        return not self.reason

    @property
    def motion_s(self) -> float:
        """The time that it took [s]."""
        return float(self.time_s[-1]) if len(self.time_s) else 0.0

    @property
    def n_lift_offs(self) -> int:
        """How often the probe was taken off the organ."""
        is_lift = self.phases == int(Phase.LIFT)
        return int(np.sum(is_lift & ~np.r_[False, is_lift[:-1]]))

    @property
    def contact_path_m(self) -> float:
        """The length of the tip's way over the organ [m]."""
        steps_m = np.linalg.norm(np.diff(self.tips_m, axis=0), axis=1)
        return float(steps_m[self.phases[1:] == int(Phase.SWEEP)].sum())

    @property
    def tip_path_m(self) -> float:
        """The length of the tip's way [m]."""
        return float(np.linalg.norm(np.diff(self.tips_m, axis=0), axis=1).sum())


def blocked(reason: str) -> Motion:
    """A motion that leads nowhere, and the reason for that."""
    nothing = np.empty((0, 0))
    return Motion(
        time_s=np.empty(0), states=nothing, tips_m=np.empty((0, 3)), phases=np.empty(0, dtype=np.int8),
        joint_travel_rad=None, reason=reason,
    )  # fmt: skip


def joined(motions: Sequence[Motion]) -> Motion:
    """Motions that followed one another as one; its end, and what was measured there, are those of the last.

    Args:
        motions: At least one.
    """
    last = motions[-1]
    if len(motions) == 1:
        return last
    starts_s = np.concatenate([[0.0], np.cumsum([motion.motion_s for motion in motions])])
    time_s = np.concatenate([start_s + part.time_s for start_s, part in zip(starts_s, motions, strict=False)])
    # A motion may begin with the state, and at the time, that the one before ended with.
    is_new = np.r_[True, np.diff(time_s) > 0.0]
    row_of = np.cumsum(is_new) - 1
    firsts = np.concatenate([[0], np.cumsum([len(part.time_s) for part in motions])]).astype(int)
    rows = [
        int(row_of[first + row])
        for first, part in zip(firsts, motions, strict=False)
        for row in part.passed_rows
    ]
    travels_rad = [part.joint_travel_rad for part in motions if part.joint_travel_rad is not None]
    peaks_n = [part.peak_force_n for part in motions if part.peak_force_n is not None]
    return replace(
        last,
        time_s=time_s[is_new],
        states=np.vstack([part.states for part in motions])[is_new],
        tips_m=np.vstack([part.tips_m for part in motions])[is_new],
        phases=np.concatenate([part.phases for part in motions])[is_new],
        joint_travel_rad=sum(travels_rad) if travels_rad else None,
        peak_force_n=max(peaks_n) if peaks_n else None,
        held=held_together([part.held for part in motions if part.held is not None]),
        passed=tuple(pose for part in motions for pose in part.passed),
        passed_rows=tuple(rows),
    )


class ProcedureStoppedError(WorldError):
    """The arm stopped for safety; `motion` is what it did until then."""

    def __init__(self, text: str, motion: Motion) -> None:
        """Keep the motion beside the sentence."""
        super().__init__(text)
        self.motion = motion


class MotionModel(ABC):
    """What moves the probe of one episode from pose to pose, and remembers where it is."""

    travel: Travel | None = None
    """Estimates how long ways take; None where there is no estimate."""
    notices: tuple[str, ...] = ()
    """What is to be known about the motion: with which limits an arm moves."""
    senses_in_motion: bool = False
    """Whether the time of sensing is a part of the motion."""

    def extended(self, situation: Situation) -> Situation:
        """A situation with what a planner may know of how the probe moves beside it."""
        return situation

    def ranking(self, planner: Planner, situation: Situation) -> Iterator[int]:
        """The poses to try to bring the probe to, best first.

        Args:
            planner: Ranks them.
            situation: What is known so far.
        """
        return planner.rank(situation)

    def halts(self, data: mujoco.MjData, motion: Motion) -> Iterator[int | None]:
        """Brings a state to each place of a motion at which a reading is taken, one after the other, the end being one.

        Args:
            data: The state at the end of the motion.
            motion: The motion.

        Yields:
            The index of the pose there; None for the pose that the motion led to.
        """
        yield None

    def stand_at(self, data: mujoco.MjData, pose: int) -> str:
        """Takes the probe to be at a pose to which something else has brought it.

        Args:
            data: The state at the pose, which is left as it is.
            pose: Index in the workspace.

        Returns:
            Why it cannot be lifted from there, as a sentence, and is not taken to be there; empty where it can.
        """
        raise NotImplementedError(
            f"{type(self).__name__} moves the probe by itself alone, to pose {pose} too"
        )

    @abstractmethod
    def move(self, data: mujoco.MjData, pose: int) -> Motion:
        """Bring a state to a pose that the positioner reaches.

        Args:
            data: A state of the episode's scene; its kinematics are up to date after. It is as it was where no motion
                began, and where the arm got to where it began and the pose was missed.
            pose: Index in the workspace.

        Returns:
            The motion, with a reason where the pose was not reached. The next one begins where this one ended.

        Raises:
            ProcedureStoppedError: The arm stopped on its way.
        """


def state_of(data: mujoco.MjData) -> NDArray[np.float64]:
    """The joint positions of a state, or the pose of a free probe's body."""
    return data.qpos.copy() if data.model.nq else np.concatenate([data.mocap_pos[0], data.mocap_quat[0]])


def set_state(data: mujoco.MjData, state: NDArray[np.float64]) -> None:
    """Bring a scene to a state that a motion went through; its kinematics are up to date after."""
    if data.model.nq:
        data.qpos[:] = state
    else:
        data.mocap_pos[0], data.mocap_quat[0] = state[:3], state[3:]
    mujoco.mj_fwdPosition(data.model, data)


def lifted_state(data: mujoco.MjData, positioner: Positioner, tip_site: str) -> NDArray[np.float64] | str:
    """The state with the tip lifted along its beam to the stand-off, or why there is none; `data` stays as it is."""
    before, tip = state_of(data), data.site(tip_site)
    T = np.eye(4)
    T[:3, :3] = tip.xmat.reshape(3, 3)
    T[:3, 3] = tip.xpos - IkSettings().standoff_m * T[:3, 2]
    reason = positioner.shift(data, T)
    lifted = state_of(data)
    set_state(data, before)
    return reason or lifted


def joint_travel_rad(model: mujoco.MjModel, q: NDArray[np.float64]) -> float | None:
    """The sum of the ways of all turning joints over states, shape (T, nq); None without joints."""
    if model.nq == 0:
        return None
    is_hinge = model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)
    return float(np.abs(np.diff(q, axis=0))[:, is_hinge].sum())

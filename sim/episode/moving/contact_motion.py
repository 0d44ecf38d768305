"""A motion model for an organ that is not where it was planned: the probe comes down until it meets it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.motion.settings import MotionSettings

from ..positioner import Positioner
from .motion import Motion, MotionModel, Phase, joint_travel_rad, state_of

FindContact = Callable[[mujoco.MjData, NDArray[np.float64], float], tuple[NDArray[np.float64] | str, float]]
"""Where the tip that is sent to a planned pose (4, 4), at some time since the motion began [s], meets the organ, world
frame (4, 4), or why it does not; and how long it waits before it senses [s]."""


class ContactMotion(MotionModel):
    """Another model's motion, whose end is shifted to where the probe meets the organ; there it waits, if it has to."""

    def __init__(
        self,
        inner: MotionModel,
        positioner: Positioner,
        tip_site: str,
        find_contact: FindContact,
        settings: MotionSettings,
    ) -> None:
        """Move as another model does, and go on from where that one ends.

        Args:
            inner: Moves the probe to where the poses were planned.
            positioner: Shifts the tip from there.
            tip_site: The site of the tip.
            find_contact: Tells where the probe meets the organ.
            settings: Speeds.
        """
        self._inner, self._positioner, self._tip_site = inner, positioner, tip_site
        self._find_contact, self._settings = find_contact, settings
        self.travel, self.notices = inner.travel, inner.notices
        self._left: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def move(self, data: mujoco.MjData, pose: int) -> Motion:
        """See `MotionModel.move`."""
        motion = self._inner.move(data, pose)
        if not motion.is_done:
            return motion
        motion = self._from_where_it_was(motion)
        tip = data.site(self._tip_site)
        T_planned = np.eye(4)
        T_planned[:3, :3], T_planned[:3, 3] = tip.xmat.reshape(3, 3), tip.xpos
        T_contact, wait_s = self._find_contact(data, T_planned, motion.motion_s)
        if isinstance(T_contact, str):
            return self._missed(motion, T_contact)
        if reason := self._positioner.shift(data, T_contact):
            return self._missed(motion, reason)
        self._left = (state_of(data), data.site(self._tip_site).xpos.copy())
        motion = self._with_station(motion, *self._left, Phase.DESCEND)
        if wait_s > 0.0:
            motion = self._with_station(motion, *self._left, Phase.HOLD, wait_s)
        return replace(motion, joint_travel_rad=joint_travel_rad(data.model, motion.states))

    def _missed(self, motion: Motion, reason: str) -> Motion:
        """The motion to a pose where the probe met nothing, from which the next one begins."""
        self._left = None
        return replace(motion, reason=reason)

    def _from_where_it_was(self, motion: Motion) -> Motion:
        """The inner motion, begun where the probe was shifted to last time."""
        if self._left is None:
            return motion
        state, tip_m = self._left
        way_s = self._seconds(tip_m, motion.tips_m[0])
        if way_s == 0.0:
            return motion
        return replace(
            motion,
            time_s=np.concatenate([[0.0], motion.time_s + way_s]),
            states=np.vstack([state, motion.states]),
            tips_m=np.vstack([tip_m, motion.tips_m]),
            phases=np.append(np.int8(Phase.LIFT), motion.phases),
        )

    def _with_station(
        self,
        motion: Motion,
        state: NDArray[np.float64],
        tip_m: NDArray[np.float64],
        phase: Phase,
        seconds: float | None = None,
    ) -> Motion:
        """The motion with one more state at its end, at the speed of an approach unless it takes given seconds."""
        seconds = self._seconds(motion.tips_m[-1], tip_m) if seconds is None else seconds
        if seconds <= 0.0:
            return motion
        return replace(
            motion,
            time_s=np.append(motion.time_s, motion.motion_s + seconds),
            states=np.vstack([motion.states, state]),
            tips_m=np.vstack([motion.tips_m, tip_m]),
            phases=np.append(motion.phases, np.int8(phase)),
        )

    def _seconds(self, start_m: NDArray[np.float64], end_m: NDArray[np.float64]) -> float:
        return float(np.linalg.norm(end_m - start_m)) / self._settings.approach_speed_m_s

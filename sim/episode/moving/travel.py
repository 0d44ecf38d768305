"""Travel: the modelled time of the way from pose to pose, without searching a path for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.settings import MotionSettings

from ..positioner import Positioner


class Travel:
    """An estimate of how long a positioner's motions take: all joints go straight, and start and stop together."""

    def __init__(
        self, positioner: Positioner, limits: JointLimits | None, settings: MotionSettings | None = None
    ) -> None:
        """Take configurations from `positioner`; `limits` are those of all joints of the scene, None without an arm."""
        self._positioner, self._limits = positioner, limits
        self._settings = settings or MotionSettings()

    def seconds(self, start: int, poses: NDArray[np.intp]) -> NDArray[np.float64]:
        """The time of the transfer from above one pose to above others [s], infinite for those not reached.

        Lift and descent are left out: they are the same for all.

        Args:
            start: Index of the pose at which the probe is.
            poses: Indices of the others, shape (k,).
        """
        self._positioner.prepare([start, *poses.tolist()])
        places_m, here = self._positioner.workspace.positions_m, self._positioner.reach(start)
        tip_s = np.linalg.norm(places_m[poses] - places_m[start], axis=1) / self._settings.tip_speed_m_s
        answers = [self._positioner.reach(int(pose)) for pose in poses]
        is_reached = np.array([answer.is_reached for answer in answers], dtype=bool)
        if self._limits is not None and is_reached.any() and here.is_reached:
            there = np.array([answer.q_standoff for answer in answers if answer.is_reached])
            joints_s = self._limits.rest_to_rest_s(np.abs(there - here.q_standoff)).max(axis=1)
            tip_s[is_reached] = np.maximum(tip_s[is_reached], joints_s)
        return np.where(is_reached, tip_s, np.inf)

"""The motion of a probe that jumps, with an estimate of the time that its way would take."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.settings import MotionSettings

from ..positioner import Positioner
from .motion import Motion, MotionModel, Phase, joint_travel_rad, lifted_state, set_state, state_of
from .travel import Travel


class JumpMotion(MotionModel):
    """A motion model that jumps from station to station: lift, stand-off, contact. Nothing between them is checked.

    The time is an estimate: all joints go straight and start and stop together, and the tip keeps its speed limits.
    """

    def __init__(
        self,
        positioner: Positioner,
        tip_site: str,
        limits: JointLimits | None,
        settings: MotionSettings | None = None,
    ) -> None:
        """Move what `positioner` carries; `limits` are those of all joints of the scene, None for a free probe."""
        self._positioner, self._tip_site, self._limits = positioner, tip_site, limits
        self._settings = settings or MotionSettings()
        self.travel = Travel(positioner, limits, self._settings)
        self._last: int | None = None
        self._up: list[NDArray[np.float64]] = []

    def stand_at(self, data: mujoco.MjData, pose: int) -> str:
        """See `MotionModel.stand_at`."""
        above = lifted_state(data, self._positioner, self._tip_site)
        if isinstance(above, str):
            return above
        self._last, self._up = pose, [state_of(data), above]
        return ""

    def move(self, data: mujoco.MjData, pose: int) -> Motion:
        """See `MotionModel.move`."""
        stations = [(pose, True, Phase.TRANSFER), (pose, False, Phase.DESCEND)]
        if self._last is not None:
            stations = [(self._last, False, Phase.LIFT), (self._last, True, Phase.LIFT), *stations]
        tips_m, states = [], []
        # An arm comes from where it stands, a free probe from nowhere.
        if self._last is None and data.model.nq:
            tips_m, states = [data.site(self._tip_site).xpos.copy()], [state_of(data)]
        for at, is_lifted, phase in stations:
            if phase is Phase.LIFT and self._up:
                set_state(data, self._up[is_lifted])
            else:
                self._positioner.place(data, at, is_lifted=is_lifted)
            tips_m.append(data.site(self._tip_site).xpos.copy())
            states.append(state_of(data))
        self._last, self._up = pose, []
        phases = [Phase.TRANSFER] * (len(states) - len(stations)) + [phase for *_, phase in stations]
        q, tips = np.array(states), np.array(tips_m)
        durations_s = [
            self._duration_s(q[i], q[i + 1], tips[i : i + 2], phases[i + 1]) for i in range(len(q) - 1)
        ]
        return Motion(
            time_s=np.concatenate([[0.0], np.cumsum(durations_s)]),
            states=q,
            tips_m=tips,
            phases=np.array(phases, dtype=np.int8),
            joint_travel_rad=joint_travel_rad(data.model, q),
        )

    def _duration_s(
        self, start: NDArray[np.float64], end: NDArray[np.float64], tips_m: NDArray[np.float64], phase: Phase
    ) -> float:
        settings = self._settings
        speed = settings.tip_speed_m_s if phase is Phase.TRANSFER else settings.approach_speed_m_s
        tip_s = float(np.linalg.norm(tips_m[1] - tips_m[0])) / speed
        if self._limits is None:
            return tip_s
        joints_s = self._limits.rest_to_rest_s(np.abs(end - start))
        return max(tip_s, float(joints_s.max(initial=0.0)))

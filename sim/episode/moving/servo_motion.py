"""The motion of an arm whose servos are sent a timed path, down to a depth below the organ as planned."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.motion.arrival import Arrival
from sim.world.motion.path_search import PathSearch
from sim.world.motion.servo import ServoArm, ServoRun
from sim.world.motion.settings import MotionSettings, ServoSettings
from sim.world.motion.timing import PathTimer

from ..positioner import ArmPositioner
from .motion import Motion, Phase, ProcedureStoppedError, joint_travel_rad
from .path_motion import RECORD_DT_S, PathMotion
from .plan import Plan
from .travel import Travel


class ServoMotion(PathMotion):
    """A motion model that sends the timed path to servos; dynamics and the organ decide what they reach."""

    _pressed_by = "press_mm"

    def __init__(
        self,
        positioner: ArmPositioner,
        paths: PathSearch,
        timer: PathTimer,
        settings: MotionSettings,
        travel: Travel,
        tip_site: str,
        *,
        arm: ServoArm,
        servo: ServoSettings,
    ) -> None:
        """Move what `positioner` carries by the servos of `arm`."""
        super().__init__(positioner, paths, timer, settings, travel, tip_site)
        self._arm, self.servo = arm, servo
        self._dt_s, self._press_m = RECORD_DT_S, servo.press_m

    @property
    def stiffness_n_m(self) -> float:
        """The spring under the tip [N/m]."""
        return self._arm.stiffness_n_m

    def _follow(self, data: mujoco.MjData, plan: Plan) -> Motion:
        """See `PathMotion._follow`; the arm holds still for a while at the end."""
        every = max(1, round(RECORD_DT_S / self._arm.dt_s))
        time_s, q, speed, n_moving = self._commands(plan, self.servo.settle_s)
        run = self._arm.run(q, speed, record_every=every)
        rows = np.append(np.arange(every - 1, len(time_s), every), len(time_s) - 1)
        rows = np.unique(rows)[: len(run.states)]
        phase_rows = np.minimum(np.searchsorted(plan.time_s, time_s[rows]), len(plan.time_s) - 1)
        phases = np.where(rows >= n_moving, int(Phase.HOLD), plan.phases[phase_rows]).astype(np.int8)
        data.qpos[:] = run.states[-1]
        mujoco.mj_fwdPosition(data.model, data)
        ends_q = np.stack([run.states[-1][self._chain.columns], q[rows[-1]]])
        arrival = Arrival.of(self._chain.forward(ends_q), press_m=self._press_m)
        motion = Motion(
            time_s=time_s[rows],
            states=run.states,
            tips_m=run.tips_m,
            phases=phases,
            joint_travel_rad=joint_travel_rad(data.model, run.states),
            tracking_error_m=arrival.error_m,
            tracking_error_rad=arrival.error_rad,
            contact_force_n=float(run.force_n[-1]),
            peak_force_n=run.peak_force_n,
            reason=self.missed(run, arrival),
        )
        if run.is_stopped:
            raise ProcedureStoppedError(self.why_stopped(run), motion)
        return motion

    def _commands(
        self, plan: Plan, rest_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], int]:
        """The times, positions and speeds that servos are sent, and how many of these come before the arm rests."""
        dt_s = self._arm.dt_s
        n_moving = int(np.ceil(plan.time_s[-1] / dt_s))
        n = n_moving + round(rest_s / dt_s)
        time_s = np.asarray(dt_s * np.arange(1, n + 1), dtype=np.float64)
        q, speed = (
            np.column_stack([np.interp(time_s, plan.time_s, column) for column in part.T])
            for part in (plan.q, plan.speed)
        )
        speed[n_moving:] = 0.0
        return time_s, q, speed, n_moving

    def missed(self, run: ServoRun, arrival: Arrival) -> str:
        """Why the pose was missed; empty where it was not, or where the arm stopped."""
        if run.is_stopped:
            return ""
        if run.is_unstable:
            return "The simulated arm became unstable; its masses, or the stiffness of its joints, are far apart."
        return "" if arrival.is_there else arrival.reason()

    def why_stopped(self, run: ServoRun) -> str:
        """Why the arm stopped for safety, as a sentence with the remedy."""
        x_mm, y_mm, z_mm = 1e3 * run.tips_m[-1]
        return (
            f"The probe pressed with {run.peak_force_n:.2f} N at ({x_mm:.0f}, {y_mm:.0f}, {z_mm:.0f}) mm, above the "
            f"limit of {self.servo.force_limit_n:g} N, and the arm stopped. Press less (`{self._pressed_by}`), come "
            "down more slowly (`approach_speed_mm_s`), or raise `force_limit_n`."
        )

"""The motion of an arm along a timed, collision-free path, which it follows exactly."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sim.world.motion.curve import length, through
from sim.world.motion.path_search import PathSearch
from sim.world.motion.settings import MotionSettings
from sim.world.motion.timing import STILL, PathTimer, Trajectory

from ..positioner import ArmPositioner
from .motion import Motion, MotionModel, Phase, blocked, joint_travel_rad, lifted_state
from .plan import Plan
from .travel import Travel

RECORD_DT_S = 0.01
"""States are recorded at least this often."""
STATES_BACK = 5
"""An arm that strayed looks at every so many of its states for one from which a transfer may begin."""


class PathMotion(MotionModel):
    """A motion model in which the arm follows its timed path exactly."""

    def __init__(
        self,
        positioner: ArmPositioner,
        paths: PathSearch,
        timer: PathTimer,
        settings: MotionSettings,
        travel: Travel,
        tip_site: str,
    ) -> None:
        """Move what `positioner` carries, from its home on."""
        self._tip_site = tip_site
        self._positioner, self._paths, self._timer, self._settings = positioner, paths, timer, settings
        self.travel = travel
        self._chain = positioner.search.chain
        self._lines: dict[int, Trajectory] = {}
        self._last: int | None = None
        self._way_back: NDArray[np.float64] | None = None
        self._up: Trajectory | None = None
        self._dt_s, self._press_m = RECORD_DT_S, 0.0

    def move(self, data: mujoco.MjData, pose: int) -> Motion:
        """See `MotionModel.move`."""
        plan = self._plan(pose)
        if isinstance(plan, str):
            return blocked(plan)
        motion = self._follow(data, plan)
        self._last, self._way_back, self._up = pose, None, None
        if not motion.is_done:
            self._last, self._way_back = None, self._way_back_of(motion.states)
        return motion

    def stand_at(self, data: mujoco.MjData, pose: int) -> str:
        """See `MotionModel.stand_at`."""
        here = data.site(self._tip_site)
        position_m, normal = here.xpos.copy(), here.xmat.reshape(3, 3)[:, 2].copy()
        q, above = data.qpos[self._chain.columns].copy(), lifted_state(data, self._positioner, self._tip_site)
        if isinstance(above, str):
            return above
        path = self._paths.line(q, above[self._chain.columns], position_m, normal)
        if not path.is_free:
            return path.reason
        self._up = self._timed(path.curves[0], self._settings.approach_speed_m_s)
        self._last, self._way_back = pose, None
        return ""

    def _follow(self, data: mujoco.MjData, plan: Plan) -> Motion:
        """The motion along a plan, to the end of which the state is brought."""
        states = self._chain.full(plan.q)
        data.qpos[:] = states[-1]
        mujoco.mj_fwdPosition(data.model, data)
        return Motion(
            time_s=plan.time_s,
            states=states,
            tips_m=self._chain.forward(plan.q).tips_m,
            phases=plan.phases,
            joint_travel_rad=joint_travel_rad(data.model, states),
        )

    def _plan(self, pose: int) -> Plan | str:
        """The timed way from where the arm is to a pose, or why there is none."""
        down = self._descent(pose)
        if isinstance(down, str):
            return down
        parts = self._way_to(down.q[0])
        return parts if isinstance(parts, str) else Plan.of([*parts, (Phase.DESCEND, down)])

    def _way_to(self, standoff_q: NDArray[np.float64]) -> list[tuple[Phase, Trajectory]] | str:
        """The timed way from where the arm is to a configuration with the probe lifted, or why there is none."""
        up = self._ascent()
        start_q = self._chain.home if up is None else up.q[-1]
        parts: list[tuple[Phase, Trajectory]] = [] if up is None else [(Phase.LIFT, up)]
        if self._last is not None or self._paths.is_free_at(start_q):
            path = self._paths.transfer(start_q, standoff_q)
            if not path.is_free:
                return path.reason
            speed = self._settings.tip_speed_m_s
            parts += [(Phase.TRANSFER, self._timed(curve, speed)) for curve in path.curves]
        return parts

    def _ascent(self) -> Trajectory | None:
        """The timed way from where the arm is to where it moves freely, or None where it has not moved yet."""
        if self._up is not None:
            return self._up
        if self._last is not None:
            return self._lines[self._last].reversed()
        if self._way_back is None:
            return None
        if length(self._way_back) <= STILL:
            return Trajectory(np.zeros(1), self._way_back[-1:], np.zeros_like(self._way_back[-1:]))
        return self._timed(through(self._way_back), self._settings.approach_speed_m_s)

    def _way_back_of(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Configurations by which an arm that strayed goes back the way that it came, to where a transfer may begin.

        Args:
            states: Those that it went through, of the whole scene, shape (T, nq).
        """
        q = np.clip(states[:, self._chain.columns], self._chain.low, self._chain.high)
        for last in range(len(q) - 1, -1, -STATES_BACK):
            if self._paths.is_lifted_at(q[last]):
                return q[last:][::-1]
        return q[::-1]

    def _descent(self, pose: int) -> Trajectory | str:
        """The timed way from the stand-off down to a pose, or why there is none."""
        if pose not in self._lines:
            answer, workspace = self._positioner.reach(pose), self._positioner.workspace
            columns = self._chain.columns
            path = self._paths.line(
                answer.q[columns],
                answer.q_standoff[columns],
                workspace.positions_m[pose],
                workspace.normals[pose],
                press_m=self._press_m,
            )
            if not path.is_free:
                return path.reason
            self._lines[pose] = self._timed(path.curves[0], self._settings.approach_speed_m_s).reversed()
        return self._lines[pose]

    def _timed(self, curve: CubicSpline, tip_speed_m_s: float) -> Trajectory:
        return self._timer.time(curve, tip_speed_m_s=tip_speed_m_s, dt_s=self._dt_s)

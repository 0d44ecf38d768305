"""The motion of an arm: along a timed, collision-free path, followed exactly or simulated."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sim.world.motion.arrival import Arrival
from sim.world.motion.contact_surface import ContactSurface
from sim.world.motion.curve import length, through
from sim.world.motion.joint_limits import JointLimits, is_embedded, limits_notice
from sim.world.motion.path_check import PathCheck
from sim.world.motion.path_search import PathSearch
from sim.world.motion.servo import ServoArm, ServoRun
from sim.world.motion.settings import MotionKind, MotionSettings, ServoSettings
from sim.world.motion.timing import STILL, PathTimer, Trajectory

from ..positioner import ArmPositioner
from ..setup import Setup
from .jump_motion import JumpMotion
from .motion import Motion, MotionModel, Phase, ProcedureStoppedError, blocked, joint_travel_rad, lifted_state
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
        up = self._ascent()
        start_q = self._chain.home if up is None else up.q[-1]
        parts: list[tuple[Phase, Trajectory]] = [] if up is None else [(Phase.LIFT, up)]
        if self._last is not None or self._paths.is_free_at(start_q):
            path = self._paths.transfer(start_q, down.q[0])
            if not path.is_free:
                return path.reason
            speed = self._settings.tip_speed_m_s
            parts += [(Phase.TRANSFER, self._timed(curve, speed)) for curve in path.curves]
        return Plan.of([*parts, (Phase.DESCEND, down)])

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


class ServoMotion(PathMotion):
    """A motion model that sends the timed path to servos; dynamics and the organ decide what they reach."""

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
        self._arm, self._servo = arm, servo
        self._dt_s, self._press_m = RECORD_DT_S, servo.press_m

    def _follow(self, data: mujoco.MjData, plan: Plan) -> Motion:
        """See `PathMotion._follow`; the arm holds still for a while at the end."""
        every = max(1, round(RECORD_DT_S / self._arm.dt_s))
        time_s, q, speed, n_moving = self._commands(plan)
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
            reason=self._reason(run, arrival),
        )
        if run.is_stopped:
            raise ProcedureStoppedError(self._why_stopped(run), motion)
        return motion

    def _commands(
        self, plan: Plan
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], int]:
        """The times, positions and speeds that servos are sent, and how many of these come before the arm rests."""
        dt_s = self._arm.dt_s
        n_moving = int(np.ceil(plan.time_s[-1] / dt_s))
        n = n_moving + round(self._servo.settle_s / dt_s)
        time_s = np.asarray(dt_s * np.arange(1, n + 1), dtype=np.float64)
        q, speed = (
            np.column_stack([np.interp(time_s, plan.time_s, column) for column in part.T])
            for part in (plan.q, plan.speed)
        )
        speed[n_moving:] = 0.0
        return time_s, q, speed, n_moving

    def _reason(self, run: ServoRun, arrival: Arrival) -> str:
        """Why the pose was missed; empty where it was not, or where the arm stopped."""
        if run.is_stopped:
            return ""
        if run.is_unstable:
            return "The simulated arm became unstable; its masses, or the stiffness of its joints, are far apart."
        return "" if arrival.is_there else arrival.reason()

    def _why_stopped(self, run: ServoRun) -> str:
        x_mm, y_mm, z_mm = 1e3 * run.tips_m[-1]
        return (
            f"The probe pressed with {run.peak_force_n:.2f} N at ({x_mm:.0f}, {y_mm:.0f}, {z_mm:.0f}) mm, above the "
            f"limit of {self._servo.force_limit_n:g} N, and the arm stopped. Press less (`press_mm`), come down more "
            "slowly (`approach_speed_mm_s`), or raise `force_limit_n`."
        )


def make_motion_model(
    setup: Setup,
    kind: MotionKind = "none",
    settings: MotionSettings | None = None,
    servo: ServoSettings | None = None,
) -> MotionModel:
    """A fresh motion model for one episode on a setup.

    Args:
        setup: Gives arm, workspace and organ. A free probe always jumps.
        kind: `none` jumps from station to station, `kinematic` follows the path exactly, `servo` simulates the arm.
        settings: Speeds.
        servo: Stiffnesses and the force limit, which only `servo` needs.
    """
    settings, positioner = settings or MotionSettings(), setup.positioner
    if setup.arm is None or not isinstance(positioner, ArmPositioner):
        return JumpMotion(positioner, setup.scene.tip_site, None, settings)
    motion_model = _of_arm(setup, positioner, kind, settings, servo or ServoSettings())
    chain = positioner.search.chain
    notice = limits_notice(setup.arm.path, chain.names, chain.is_slide, settings)
    motion_model.notices = (notice,) if notice else ()
    return motion_model


def _of_arm(
    setup: Setup, positioner: ArmPositioner, kind: MotionKind, settings: MotionSettings, servo: ServoSettings
) -> MotionModel:
    """The motion model of an arm."""
    assert setup.arm is not None
    model, search = setup.scene.model, positioner.search
    chain, path = search.chain, setup.arm.path
    hinges = [name for name, slides in zip(chain.names, chain.is_slide.tolist(), strict=True) if not slides]
    is_slide = model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)
    names = [model.joint(joint).name.removeprefix("arm_") for joint in range(model.njnt)]
    limits = JointLimits.of_arm(path, is_slide, settings, names=names, hinges=hinges)
    if kind == "none":
        return JumpMotion(positioner, setup.scene.tip_site, limits, settings)
    paths = PathSearch(search, PathCheck(setup.scene, chain, search.meter, search.clearance))
    timer = PathTimer(chain, JointLimits.of_arm(path, chain.is_slide, settings, names=chain.names))
    travel = Travel(positioner, limits, settings)
    if kind == "kinematic":
        return PathMotion(positioner, paths, timer, settings, travel, setup.scene.tip_site)
    servo = servo or ServoSettings()
    organ, face_radius_m = ContactSurface(setup.organ), search.clearance.probe.face_radius_m
    arm = ServoArm(setup.scene, chain, organ, servo, is_panda=is_embedded(path), face_radius_m=face_radius_m)
    tip_site = setup.scene.tip_site
    return ServoMotion(positioner, paths, timer, settings, travel, tip_site, arm=arm, servo=servo)

"""A motion model that presses with a force: servos bring the probe down until it meets the organ, wherever that is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.frames import frames_along
from sim.world.ik.settings import IkSettings
from sim.world.motion.arrival import Arrival
from sim.world.motion.beam_contact import BeamContact
from sim.world.motion.curve import through
from sim.world.motion.force_control import ACCELERATION_M_S2, BeamLine, ForceControl, ForceGoal, beam_line
from sim.world.motion.servo import ServoRun

from ..positioner import touching
from .motion import Motion, Phase, ProcedureStoppedError, blocked, joint_travel_rad
from .organ_under_probe import OrganUnderProbe
from .path_motion import RECORD_DT_S
from .plan import Plan
from .servo_motion import ServoMotion

Array = NDArray[np.float64]

ROOM_SHARE, ROOM_M = 3.0, 0.01
"""The line goes on below where the organ is looked for by this many times the depth at which the spring has the force,
and by this [m]: thin parts of an organ yield more."""

PRESSING_S = 0.3
"""From contact to the force it takes about as long [s]."""


@dataclass(eq=False)
class _Descent:
    """One motion to a pose, as it is planned and as it goes."""

    plan: Plan | None
    """The way to above the pose; None where the arm is there."""
    wait_s: float
    """How long it waits there [s]."""
    control: ForceControl
    n_steps: int = 0
    """Commands that were sent so far."""
    n_down: int = 0
    """Those of them that came before the force was held."""
    sent_q: Array = field(default_factory=lambda: np.empty(0))
    """The last of them, shape (n,)."""


def plan_s(plan: Plan | None) -> float:
    """How long a plan takes [s]."""
    return 0.0 if plan is None else float(plan.time_s[-1])


class ForceMotion(ServoMotion):
    """Servos follow the path to above the pose, and from there the beam, down to contact and to the force."""

    _pressed_by = "press_n"

    def __init__(self, servos: ServoMotion, organ: OrganUnderProbe) -> None:
        """Move the arm of another model of servos, which is not to be used further.

        Args:
            servos: Has the arm, its paths and its settings.
            organ: Tells what the probe meets, and is told how that went.
        """
        assert servos.travel is not None
        super().__init__(
            servos._positioner,
            servos._paths,
            servos._timer,
            servos._settings,
            servos.travel,
            servos._tip_site,
            arm=servos._arm,
            servo=servos.servo,
        )
        self.notices, self._organ = servos.notices, organ
        self._contact = BeamContact(
            self._arm.model,
            organ,
            damping_n_s_m=self.servo.damping_n_s_m,
            stiffness_n_m=self._arm.stiffness_n_m,
            dt_s=self._arm.dt_s,
        )
        self._arm.tip_contact = self._contact
        self._scratch = mujoco.MjData(self._arm.model)
        self._control: ForceControl | None = None

    def move(self, data: mujoco.MjData, pose: int) -> Motion:
        """See `MotionModel.move`."""
        self._hold_while_sensing()
        descent = self._planned(pose)
        if isinstance(descent, str):
            return blocked(descent)
        motion = self._moved(data, descent)
        self._organ.moved(motion.motion_s)
        if not motion.is_done:
            self.stray(motion.states)
            return motion
        self._last, self._control, self._way_back = pose, descent.control, None
        contact = self._contact
        self._organ.pressed(contact.T_rest_touch, contact.force_n, contact.stiffness_n_m)
        return motion

    def stand_at(self, data: mujoco.MjData, pose: int) -> str:
        """See `MotionModel.stand_at`: where a slide pressed on to, and told of by `press_on`."""
        del data
        self._last = pose
        return "" if self._control is not None else "The probe does not press on the organ."

    @property
    def control(self) -> ForceControl | None:
        """How the probe is pressed where it is; None where it is not."""
        return self._control

    @property
    def contact(self) -> BeamContact:
        """What the tip meets."""
        return self._contact

    @property
    def dt_s(self) -> float:
        """Time of one step of the dynamics [s]."""
        return self._arm.dt_s

    @property
    def goal(self) -> ForceGoal:
        """What the probe is sent down for."""
        return ForceGoal(
            force_n=self._organ.force_n,
            search_m=self._organ.search_m,
            speed_m_s=self._settings.approach_speed_m_s,
            settle_s=self.servo.settle_s,
            wait_s=self._organ.wait_s,
        )

    def follow(self, commands: Iterator[tuple[Array, Array]], *, record_every: int) -> ServoRun:
        """What the arm does that is sent one command a step; every so many steps are recorded."""
        return self._arm.follow(commands, record_every=record_every)

    def press_on(self, line: BeamLine, along_m: float) -> None:
        """Take the probe to press at a place on another line, to which its servos were sent."""
        self._control = ForceControl(line, self._contact, self.goal, dt_s=self._arm.dt_s)
        self._control.along_m, self._way_back = along_m, None

    def stray(self, states: Array) -> None:
        """Take the arm to be off its way after some states of the scene, shape (T, nq)."""
        self._last, self._control, self._up = None, None, None
        self._way_back = self._way_back_of(states)

    def _hold_while_sensing(self) -> None:
        """Hold the force while time has passed since the last motion, and lay the way up from where that ends."""
        control, contact = self._control, self._contact
        passed_s, contact.time_s = self._organ.time_s - contact.time_s, self._organ.time_s
        if control is None:
            return
        if self._organ.is_moving and passed_s > 0.0:
            contact.time_s -= passed_s
            self._arm.follow(control.hold(passed_s), record_every=round(passed_s / self._arm.dt_s) + 1)
            contact.time_s = self._organ.time_s
        way = control.line.way_up(control.along_m)
        self._up = self._timed(through(way), self._settings.approach_speed_m_s)

    def _planned(self, pose: int) -> _Descent | str:
        """The way to a pose and down its beam, or why there is none."""
        organ, settings = self._organ, self._settings
        speed_m_s = settings.approach_speed_m_s
        down_s = IkSettings().standoff_m / speed_m_s + 0.5 * speed_m_s / ACCELERATION_M_S2
        # Where an organ that breathes is expected depends on when the probe gets there, and the way there on where.
        expected_s = organ.time_s + organ.wait_s(organ.time_s)
        found = self._way_above(pose, expected_s)
        if not isinstance(found, str) and organ.is_moving:
            plan, _ = found
            arrived_s = organ.time_s + down_s + plan_s(plan)
            found = self._way_above(pose, arrived_s + self._wait_s(arrived_s))
        if isinstance(found, str):
            return found
        plan, line = found
        wait_s = self._wait_s(organ.time_s + down_s + plan_s(plan))
        return _Descent(plan, wait_s, ForceControl(line, self._contact, self.goal, dt_s=self._arm.dt_s))

    def _wait_s(self, arrived_s: float) -> float:
        """How long the probe waits above the organ, which is to rest from contact until the force was held [s]."""
        organ, held_s = self._organ, self.servo.settle_s + PRESSING_S
        wait_s = organ.wait_s(arrived_s)
        if wait_s > 0.0 or (next_s := organ.wait_s(arrived_s + held_s)) == 0.0:
            return wait_s
        return held_s + next_s

    def _way_above(self, pose: int, expected_s: float) -> tuple[Plan | None, BeamLine] | str:
        """The way to above a pose, and the line from there, where the organ is believed to lie at a time."""
        line = self._line(pose, self._organ.T_world_rest_believed(expected_s))
        if line.end_m <= 0.0:
            return f"The arm cannot bring the probe down to where the organ is expected. {line.reason}"
        parts = self._way_to(line.q[0])
        if isinstance(parts, str):
            return parts
        return Plan.of(parts) if parts else None, line

    def _line(self, pose: int, T_world_rest: Array) -> BeamLine:
        """The line down to a pose where the organ is believed to lie."""
        answer, workspace = self._positioner.reach(pose), self._positioner.workspace
        seeds = (answer.q_standoff[self._chain.columns], answer.q[self._chain.columns])
        return self.line_at(workspace.positions_m[pose], workspace.normals[pose], seeds, T_world_rest)

    def line_at(
        self, place_m: Array, beam: Array, seeds: tuple[Array, Array], T_world_rest: Array | None = None
    ) -> BeamLine:
        """The line down to a place of the planned organ, and below it.

        Args:
            place_m: On the surface, shape (3,).
            beam: Where the beam points, shape (3,).
            seeds: Configurations near those above the place and at it, shape (n,) each.
            T_world_rest: Where the organ is believed to lie, shape (4, 4); None where it was planned.
        """
        T_planned = np.eye(4)
        T_planned[:3, :3], T_planned[:3, 3] = frames_along(beam[None])[0], place_m
        room_m = ROOM_SHARE * self._organ.force_n / self._arm.stiffness_n_m + ROOM_M
        return beam_line(
            self._chain,
            T_planned if T_world_rest is None else T_world_rest @ T_planned,
            seeds,
            above_m=IkSettings().standoff_m,
            below_m=self._organ.search_m + room_m,
            touching=self._touching,
        )

    def _touching(self, q: Array) -> str:
        self._scratch.qpos[:] = self._chain.full(q)
        mujoco.mj_fwdPosition(self._arm.model, self._scratch)
        return touching(self._scratch)

    def _sent(self, descent: _Descent) -> Iterator[tuple[Array, Array]]:
        """The commands of a motion, one a step."""
        if descent.plan is not None:
            _, way_q, way_speed, _ = self._commands(descent.plan, 0.0)
            for q, speed in zip(way_q, way_speed, strict=True):
                descent.n_steps, descent.sent_q = descent.n_steps + 1, q
                self._contact.time_s += self._arm.dt_s
                yield q, speed
        self._contact.time_s += descent.wait_s
        descent.n_down = descent.n_steps
        for q, speed in descent.control.commands():
            descent.n_steps, descent.sent_q = descent.n_steps + 1, q
            if descent.control.held_s == 0.0:
                descent.n_down = descent.n_steps
            yield q, speed

    def _moved(self, data: mujoco.MjData, descent: _Descent) -> Motion:
        """Simulate a motion, to the end of which the state is brought."""
        every = max(1, round(RECORD_DT_S / self._arm.dt_s))
        run = self._arm.follow(self._sent(descent), record_every=every)
        data.qpos[:] = run.states[-1]
        mujoco.mj_fwdPosition(data.model, data)
        control, goal_n = descent.control, self._organ.force_n
        ends_q = np.stack([run.states[-1][self._chain.columns], descent.sent_q])
        went_m = control.along_m - control.line.start_m
        arrival = Arrival.of(self._chain.forward(ends_q), press_m=went_m)
        time_s, phases = self._recorded(descent, every)
        motion = Motion(
            time_s=time_s,
            states=run.states,
            tips_m=run.tips_m,
            phases=phases,
            joint_travel_rad=joint_travel_rad(data.model, run.states),
            tracking_error_m=arrival.error_m,
            tracking_error_rad=arrival.error_rad,
            contact_force_n=float(run.force_n[-1]),
            force_error_n=float(run.force_n[-1]) - goal_n,
            peak_force_n=run.peak_force_n,
            reason="" if run.is_stopped else control.reason or self.missed(run, arrival),
        )
        if run.is_stopped:
            raise ProcedureStoppedError(self.why_stopped(run), motion)
        return motion

    def _recorded(self, descent: _Descent, every: int) -> tuple[Array, NDArray[np.int8]]:
        """Times [s] and phases of the states that were recorded, every so many steps and the last one."""
        plan, n_steps, dt_s = descent.plan, descent.n_steps, self._arm.dt_s
        n_way = int(np.ceil(plan_s(plan) / dt_s))
        rows = np.unique(np.append(np.arange(every - 1, n_steps, every), n_steps - 1))
        time_s = dt_s * (rows + 1.0) + np.where(rows >= n_way, descent.wait_s, 0.0)
        phases = np.where(rows >= descent.n_down, int(Phase.HOLD), int(Phase.DESCEND)).astype(np.int8)
        if plan is not None:
            is_on_way = rows < n_way
            at = np.minimum(np.searchsorted(plan.time_s, time_s[is_on_way]), len(plan.time_s) - 1)
            phases[is_on_way] = plan.phases[at]
        return time_s, phases

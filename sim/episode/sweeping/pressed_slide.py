"""The slide of an arm whose servos hold a force: the way is planned on the surface, and gone with the face in it."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sim.world.ik.damped_least_squares import descend
from sim.world.motion.arrival import Arrival
from sim.world.motion.path_search import LINE_TOLERANCE_M, MAX_SLIDE_TURN_RAD
from sim.world.motion.servo import ServoRun
from sim.world.motion.timing import PathTimer

from ..moving.force_motion import ForceMotion
from ..moving.held_force import HeldForce
from ..moving.motion import Motion, Phase, ProcedureStoppedError, joint_travel_rad
from ..moving.path_motion import RECORD_DT_S
from .slide_control import SlideControl
from .slides import SLIDE_TILT_RAD, ArmSlide, Slide, rows_at
from .surface_way import SurfaceWay

Array = NDArray[np.float64]


class PressedSlide(Slide):
    """Goes ways of which an arm without servos could go the surface, by servos that hold the force of the landing."""

    def __init__(
        self, on_surface: ArmSlide, presser: ForceMotion, timer: PathTimer, tip_speed_m_s: float
    ) -> None:
        """Slide where `presser` has brought the probe down.

        Args:
            on_surface: Plans and checks the way on the surface.
            presser: Has the servos, and lands and lifts the probe.
            timer: Times the way.
            tip_speed_m_s: Speed limit of the tip along it.
        """
        self._on_surface, self._presser, self._timer = on_surface, presser, timer
        self._speed, self._chain = tip_speed_m_s, on_surface.chain
        self.nothing_held = HeldForce.nothing(presser.goal.force_n)

    def move(self, data: mujoco.MjData, way: SurfaceWay, rows: NDArray[np.intp]) -> Motion | str:
        """See `Slide.move`."""
        presser = self._presser
        if presser.control is None:
            return "The probe does not press on the organ."
        line, depth_m = presser.control.line, presser.control.along_m
        planned = self._on_surface.planned(line.at(0.0)[0], way)
        if isinstance(planned, str):
            return planned
        pressed = self._below(planned.q, line.at(depth_m)[0], way, depth_m)
        if isinstance(pressed, str):
            return pressed
        up = presser.line_at(way.places_m[-1], way.beams[-1], (pressed[-1], pressed[-1]))
        if up.end_m < depth_m:
            return f"The arm could not be lifted at the end of the way. {up.reason}".strip()
        curve = CubicSpline(np.arange(len(pressed), dtype=np.float64), pressed)
        timed = self._timer.time(curve, tip_speed_m_s=self._speed, dt_s=RECORD_DT_S)
        control = SlideControl(self._chain, timed, presser.contact, presser.goal, dt_s=presser.dt_s)
        motion = self._gone(data, control, way, rows)
        if motion.is_done:
            presser.press_on(up, depth_m + control.shift_m)
        else:
            presser.stray(motion.states)
        return motion

    def _below(self, q: Array, first: Array, way: SurfaceWay, depth_m: float) -> Array | str:
        """Configurations with the tip below the places of a way along the beam, shape (K, n), or why there are none.

        Args:
            q: Those with it on the surface, shape (K, n).
            first: Where the servos are sent now, shape (n,).
            way: The way.
            depth_m: How far below [m].
        """
        seeds = np.clip(q + (first - q[0]), self._chain.low, self._chain.high)
        found = descend(
            self._chain, seeds, way.places_m + depth_m * way.beams, way.beams, centring_gain=0.0,
            position_tolerance_m=LINE_TOLERANCE_M, angle_tolerance_rad=SLIDE_TILT_RAD,
        )  # fmt: skip
        is_there = (found.distance_m <= LINE_TOLERANCE_M) & (found.angle_rad <= SLIDE_TILT_RAD)
        below = np.vstack([first, found.q[1:]])
        if not is_there[1:].all() or np.abs(np.diff(below, axis=0)).max() > MAX_SLIDE_TURN_RAD:
            return "The arm cannot press on the organ all the way."
        return below

    def _gone(
        self, data: mujoco.MjData, control: SlideControl, way: SurfaceWay, rows: NDArray[np.intp]
    ) -> Motion:
        """Simulate a slide, to the end of which the state is brought."""
        presser, dt_s = self._presser, self._presser.dt_s
        every = max(1, round(RECORD_DT_S / dt_s))
        run = presser.follow(control.commands(), record_every=every)
        data.qpos[:] = run.states[-1]
        mujoco.mj_fwdPosition(data.model, data)
        at = np.unique(np.append(np.arange(every - 1, len(control.sent_q), every), len(control.sent_q) - 1))
        sent = self._chain.forward(np.array(control.sent_q)[at[: len(run.states)]])
        ends_q = np.stack([run.states[-1][self._chain.columns], control.sent_q[-1]])
        arrival = Arrival.of(
            self._chain.forward(ends_q), press_m=presser.control.along_m if presser.control else 0.0
        )
        slip_m, lag_m = _beside_and_behind(run.tips_m, sent.tips_m, sent.beams)
        goal_n = presser.goal.force_n
        motion = Motion(
            time_s=dt_s * (at[: len(run.states)] + 1.0),
            states=run.states,
            tips_m=run.tips_m,
            phases=np.full(len(run.states), Phase.SWEEP, dtype=np.int8),
            joint_travel_rad=joint_travel_rad(data.model, run.states),
            tracking_error_m=arrival.error_m,
            tracking_error_rad=arrival.error_rad,
            contact_force_n=float(run.force_n[-1]),
            force_error_n=float(run.force_n[-1]) - goal_n,
            peak_force_n=run.peak_force_n,
            held=HeldForce(wanted_n=goal_n, force_n=np.array(control.force_n), slip_m=slip_m, lag_m=lag_m),
            reason=self._reason(run, arrival),
            passed_rows=tuple(rows_at(run.tips_m, way.along_m[rows] / way.along_m[-1])),
        )
        if run.is_stopped:
            raise ProcedureStoppedError(presser.why_stopped(run), motion)
        return motion

    def _reason(self, run: ServoRun, arrival: Arrival) -> str:
        """Why the end was missed; empty where it was not."""
        return "" if run.is_stopped else self._presser.missed(run, arrival)


def _beside_and_behind(tips_m: Array, sent_m: Array, beams: Array) -> tuple[Array, Array]:
    """How far tips are beside the way, across it and the beam, and how far along it, from where they were sent [m].

    Args:
        tips_m: Where the tip was, shape (R, 3).
        sent_m: Where it was sent, shape (R, 3).
        beams: The beam that was sent, shape (R, 3).
    """
    ways = np.gradient(sent_m, axis=0) if len(sent_m) > 1 else np.zeros_like(sent_m)
    ways -= np.einsum("ij,ij->i", ways, beams)[:, None] * beams
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
    off_m = tips_m - sent_m
    beside = np.cross(beams, ways)
    return np.abs(np.einsum("ij,ij->i", off_m, beside)), np.abs(np.einsum("ij,ij->i", off_m, ways))

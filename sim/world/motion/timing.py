"""Timing: the fastest way along a joint path within limits of speed and acceleration, by toppra where it is installed.

Pham and Pham, A new approach to time-optimal path parameterization based on reachability analysis, 2018.
There are wheels of toppra for Linux on x86-64 alone; elsewhere `plain_timing` times the same paths, somewhat slower.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from sim.extras import EXTRAS
from sim.world.errors import WorldError
from sim.world.ik.chain import Array, Chain

from .joint_limits import JointLimits
from .plain_timing import plain_motion

if TYPE_CHECKING:
    # toppra imports pyplot, which is slow to load, and only arms that move need it.
    from toppra.constraint import Constraint

MIN_GRID_POINTS, GRID_POINTS_PER_KNOT = 36, 2
"""Points of a path at which toppra holds the limits; between them it exceeds them a little."""
LIMIT_SHARE = 0.98
"""Share of the limits that toppra is given for this reason; where that is not enough, the motion is slowed down."""
TIP_POINTS_PER_KNOT = 4
"""Chords between two knots that measure the way of the tip."""
N_CHECKED_TIMES = 400
"""Times of a motion at which it is seen whether it is enough."""
HELD_DT_S = 0.005
"""Control points of a motion that is held within the joints' limits are this far apart [s]."""
TIP_DT_S = 0.002
"""The tip's speed is looked at this often [s]: at a sharp turn of the path it peaks for some milliseconds."""
PLAIN_TIP_DT_S = 0.0005
"""The same for motions without toppra, which change their acceleration more often [s]."""
TIP_SLACK = 1e-3
"""Share by which the tip may be faster for some milliseconds, between the times at which the motion is looked at."""
BEYOND = 1e-9
"""A joint this far beyond a limit is there by rounding [rad or m]."""
STILL = 1e-7
"""A path shorter than this, the largest turn of a joint [rad or m], takes no time."""
TIP_ACCELERATION_M_S2 = 1e3
"""So large that the tip's acceleration is bounded only by the joints'."""

Followed = Callable[[Array, int], Array]
"""Configurations and the way of the tip at some times, shape (T, n + 1), or their derivatives of an order."""

logging.getLogger("toppra").setLevel(logging.ERROR)


class TimingError(WorldError):
    """A path that cannot be timed."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Configurations of a chain in time, at rest at both ends."""

    time_s: Array
    """From 0 [s], shape (T,)."""
    q: Array
    """[rad or m], shape (T, n)."""
    speed: Array
    """[rad/s or m/s], shape (T, n)."""

    def reversed(self) -> Trajectory:
        """The same way back."""
        return Trajectory(self.time_s[-1] - self.time_s[::-1], self.q[::-1], -self.speed[::-1])


class PathTimer:
    """Times paths of one chain."""

    def __init__(self, chain: Chain, limits: JointLimits) -> None:
        """Take the arm's `limits`, in the order of the chain's joints."""
        self._chain, self._limits = chain, limits
        self._kept: dict[float, list[Constraint]] = {}

    def time(self, curve: CubicSpline, *, tip_speed_m_s: float, dt_s: float) -> Trajectory:
        """The fastest motion along a curve from rest to rest.

        Args:
            curve: Configurations, shape (n,), over the knots of the spline.
            tip_speed_m_s: The tip moves no faster.
            dt_s: Longest time between two samples of the result.

        Raises:
            TimingError: toppra finds no motion along this curve.
        """
        knots = curve.x
        q = curve(knots)
        if knots[-1] <= STILL:
            return Trajectory(np.zeros(1), q[:1], np.zeros_like(q[:1]))
        between = np.linspace(0.0, knots[-1], TIP_POINTS_PER_KNOT * (len(knots) - 1) + 1)
        steps_m = np.linalg.norm(np.diff(self._chain.forward(curve(between)).tips_m, axis=0), axis=1)
        way_m = np.concatenate([[0.0], np.cumsum(steps_m)])[::TIP_POINTS_PER_KNOT]
        points = np.column_stack([q, way_m])
        has_toppra = EXTRAS["toppra"].is_installed
        if has_toppra:
            timed, fastest_s = self._by_toppra(knots, points, tip_speed_m_s)
        else:
            speed, acceleration = self._given_limits(tip_speed_m_s)
            timed, fastest_s = plain_motion(knots, points, speed, acceleration)
        followed = self._within_limits(timed, fastest_s)
        tip_dt_s = TIP_DT_S if has_toppra else PLAIN_TIP_DT_S
        slowing = self._slowing(followed, fastest_s, tip_speed_m_s, tip_dt_s)
        duration_s = slowing * fastest_s
        time_s = np.linspace(0.0, duration_s, int(np.ceil(duration_s / dt_s)) + 1)
        q, rate = followed(time_s / slowing, 0)[:, :-1], followed(time_s / slowing, 1)[:, :-1]
        return Trajectory(time_s, q, rate / slowing)

    def _by_toppra(self, knots: Array, points: Array, tip_speed_m_s: float) -> tuple[Followed, float]:
        """The fastest motion along a spline, and its duration [s]."""
        from toppra import SplineInterpolator
        from toppra.algorithm import TOPPRA

        n_grid = max(MIN_GRID_POINTS, GRID_POINTS_PER_KNOT * len(knots))
        grid = np.linspace(0.0, knots[-1], n_grid)
        path, constraints = SplineInterpolator(knots, points), self._constraints(tip_speed_m_s)
        toppra = TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel")
        timed = toppra.compute_trajectory(0.0, 0.0)
        if timed is None:
            raise TimingError(
                "toppra found no motion along a path within the joints' limits; raise the limits."
            )
        return timed, float(timed.path_interval[1])

    def _given_limits(self, tip_speed_m_s: float) -> tuple[Array, Array]:
        """Limits of speed and acceleration of the joints and of the tip's way, each of shape (n + 1,)."""
        speed = LIMIT_SHARE * np.append(self._limits.speed, tip_speed_m_s)
        return speed, LIMIT_SHARE * np.append(self._limits.acceleration, TIP_ACCELERATION_M_S2)

    def _constraints(self, tip_speed_m_s: float) -> list[Constraint]:
        """The limits as toppra takes them, kept, since toppra writes each as text when it is made, which is slow."""
        from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

        if tip_speed_m_s not in self._kept:
            speed, acceleration = self._given_limits(tip_speed_m_s)
            self._kept[tip_speed_m_s] = [
                JointVelocityConstraint(np.column_stack([-speed, speed])),
                JointAccelerationConstraint(np.column_stack([-acceleration, acceleration])),
            ]
        return self._kept[tip_speed_m_s]

    def _within_limits(self, timed: Followed, duration_s: float) -> Followed:
        """The motion itself where it keeps the joints' limits, or one that does.

        A spline swings beyond its points where they turn sharply, by some tenths of a milliradian. Where that takes a
        joint beyond a limit, the control points of the joint's curve are brought back to the limit: a B-spline stays
        between its least and its greatest control point. They lie close, so that this changes the motion by hardly
        more than what it was beyond.
        """
        time_s = np.linspace(0.0, duration_s, max(4, int(np.ceil(duration_s / HELD_DT_S)) + 1))
        points, low, high = timed(time_s, 0), self._chain.low, self._chain.high
        beyond = np.maximum(low - points[:, :-1], points[:, :-1] - high).max(axis=0)
        joints = np.flatnonzero(beyond > BEYOND)
        if not len(joints):
            return timed
        # At rest at both ends: the first derivative is zero there.
        spline = make_interp_spline(time_s, points, k=3, bc_type="clamped")
        controls = spline.c.copy()
        controls[:, joints] = np.clip(controls[:, joints], low[joints], high[joints])
        held = BSpline(spline.t, controls, 3)
        return lambda at_s, order: held(at_s, nu=order)

    def _slowing(self, followed: Followed, duration_s: float, tip_speed_m_s: float, tip_dt_s: float) -> float:
        """The least factor, 1 or more, by which the motion is slowed down to hold all limits between grid points."""
        time_s = np.linspace(0.0, duration_s, N_CHECKED_TIMES)
        speed, acceleration = np.abs(followed(time_s, 1)).max(axis=0), np.abs(followed(time_s, 2)).max(axis=0)
        by_speed = speed / np.append(self._limits.speed, tip_speed_m_s)
        by_acceleration = np.sqrt(acceleration[:-1] / self._limits.acceleration)
        slowing = float(max(1.0, by_speed.max(), by_acceleration.max()))
        by_tip = self._tip_speed_m_s(followed, duration_s, tip_dt_s) / tip_speed_m_s
        return by_tip if by_tip > slowing * (1.0 + TIP_SLACK) else slowing

    def _tip_speed_m_s(self, followed: Followed, duration_s: float, dt_s: float) -> float:
        """The largest speed of the tip by the joints' speeds: the way that toppra holds is a spline, and not exact."""
        time_s = np.linspace(0.0, duration_s, max(N_CHECKED_TIMES, int(np.ceil(duration_s / dt_s)) + 1))
        velocity = self._chain.jacobian(self._chain.forward(followed(time_s, 0)[:, :-1]))[:, :3]
        rate = followed(time_s, 1)[:, :-1]
        return float(np.linalg.norm(np.einsum("tij,tj->ti", velocity, rate), axis=1).max())

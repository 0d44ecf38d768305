"""Timing: the fastest way along a joint path within limits of speed and acceleration, by toppra.

Pham and Pham, A new approach to time-optimal path parameterization based on reachability analysis, 2018.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from sim.world.errors import WorldError
from sim.world.ik.chain import Array, Chain

from .joint_limits import JointLimits

if TYPE_CHECKING:
    # toppra imports pyplot, which is slow to load, and only arms that move need it.
    from toppra.constraint import Constraint
    from toppra.interpolator import AbstractGeometricPath

MIN_GRID_POINTS, GRID_POINTS_PER_KNOT = 36, 2
"""Points of a path at which toppra holds the limits; between them it exceeds them a little."""
LIMIT_SHARE = 0.98
"""Share of the limits that toppra is given for this reason; where that is not enough, the motion is slowed down."""
TIP_POINTS_PER_KNOT = 4
"""Chords between two knots that measure the way of the tip."""
N_CHECKED_TIMES = 400
"""Times of a motion at which it is seen whether it is enough."""
STILL = 1e-7
"""A path shorter than this, the largest turn of a joint [rad or m], takes no time."""
TIP_ACCELERATION_M_S2 = 1e3
"""So large that the tip's acceleration is bounded only by the joints'."""

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
        from toppra import SplineInterpolator
        from toppra.algorithm import TOPPRA

        knots = curve.x
        q = curve(knots)
        if knots[-1] <= STILL:
            return Trajectory(np.zeros(1), q[:1], np.zeros_like(q[:1]))
        between = np.linspace(0.0, knots[-1], TIP_POINTS_PER_KNOT * (len(knots) - 1) + 1)
        steps_m = np.linalg.norm(np.diff(self._chain.forward(curve(between)).tips_m, axis=0), axis=1)
        way_m = np.concatenate([[0.0], np.cumsum(steps_m)])[::TIP_POINTS_PER_KNOT]
        path = SplineInterpolator(knots, np.column_stack([q, way_m]))
        n_grid = max(MIN_GRID_POINTS, GRID_POINTS_PER_KNOT * len(knots))
        grid = np.linspace(0.0, knots[-1], n_grid)
        constraints = self._constraints(tip_speed_m_s)
        toppra = TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel")
        timed = toppra.compute_trajectory(0.0, 0.0)
        if timed is None:
            raise TimingError(
                "toppra found no motion along a path within the joints' limits; raise the limits."
            )
        slowing = self._slowing(timed, tip_speed_m_s)
        duration_s = slowing * float(timed.path_interval[1])
        time_s = np.linspace(0.0, duration_s, int(np.ceil(duration_s / dt_s)) + 1)
        q, rate = timed(time_s / slowing)[:, :-1], timed(time_s / slowing, 1)[:, :-1]
        return Trajectory(time_s, q, rate / slowing)

    def _constraints(self, tip_speed_m_s: float) -> list[Constraint]:
        """The limits as toppra takes them, kept, since toppra writes each as text when it is made, which is slow."""
        from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

        if tip_speed_m_s not in self._kept:
            speed = LIMIT_SHARE * np.append(self._limits.speed, tip_speed_m_s)
            acceleration = LIMIT_SHARE * np.append(self._limits.acceleration, TIP_ACCELERATION_M_S2)
            self._kept[tip_speed_m_s] = [
                JointVelocityConstraint(np.column_stack([-speed, speed])),
                JointAccelerationConstraint(np.column_stack([-acceleration, acceleration])),
            ]
        return self._kept[tip_speed_m_s]

    def _slowing(self, timed: AbstractGeometricPath, tip_speed_m_s: float) -> float:
        """The least factor, 1 or more, by which the motion is slowed down to hold all limits between grid points."""
        time_s = np.linspace(0.0, float(timed.path_interval[1]), N_CHECKED_TIMES)
        speed, acceleration = np.abs(timed(time_s, 1)).max(axis=0), np.abs(timed(time_s, 2)).max(axis=0)
        by_speed = speed / np.append(self._limits.speed, tip_speed_m_s)
        by_acceleration = np.sqrt(acceleration[:-1] / self._limits.acceleration)
        return float(max(1.0, by_speed.max(), by_acceleration.max()))

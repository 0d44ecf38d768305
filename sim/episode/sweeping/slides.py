"""Slides: the timed motion of a probe that glides along a way over the organ, without an arm or with one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sim.world.frames import frames_along
from sim.world.ik.chain import Chain
from sim.world.ik.damped_least_squares import Descent, descend
from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.path_search import LINE_TOLERANCE_M, PathSearch
from sim.world.motion.timing import PathTimer, Trajectory

from ..moving.held_force import HeldForce
from ..moving.motion import Motion, Phase, joint_travel_rad, state_of
from ..moving.path_motion import RECORD_DT_S
from ..positioner import ArmPositioner, Positioner
from .surface_way import SurfaceWay

EVERY = 2
"""Of the places of a way every second is reached from the one before."""
SLIDE_TILT_RAD = 0.03
"""The beam may lag behind the way's by this much: where an arm is near a singular configuration it turns slowly."""
CENTRING = 0.005
"""Share of the way to the middle of its range that a joint goes in a step there, as far as the way leaves it free."""


class Slide(ABC):
    """Brings a probe along ways over the organ."""

    nothing_held: HeldForce | None = None
    """The force of a motion without a slide, where slides hold one; None where they do not."""

    @abstractmethod
    def move(self, data: mujoco.MjData, way: SurfaceWay, rows: NDArray[np.intp]) -> Motion | str:
        """Bring a state along a way.

        Args:
            data: A state at the beginning of the way; it is brought to the end, or left where there is no motion.
            way: The way.
            rows: Places of the way whose states the motion tells in `passed_rows`.

        Returns:
            The motion, or why there is none, as a sentence.
        """


class FreeSlide(Slide):
    """The slide of a free probe, whose tip has its speed at once and keeps it."""

    def __init__(self, positioner: Positioner, tip_speed_m_s: float) -> None:
        """Bring along what `positioner` carries."""
        self._positioner, self._speed = positioner, tip_speed_m_s

    def move(self, data: mujoco.MjData, way: SurfaceWay, rows: NDArray[np.intp]) -> Motion | str:
        """See `Slide.move`."""
        states = []
        for place_m, R in zip(way.places_m, frames_along(way.beams), strict=True):
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = R, place_m
            self._positioner.shift(data, T)
            states.append(state_of(data))
        return Motion(
            time_s=way.along_m / self._speed,
            states=np.array(states),
            tips_m=way.places_m,
            phases=np.full(len(states), Phase.SWEEP, dtype=np.int8),
            joint_travel_rad=None,
            passed_rows=tuple(rows.tolist()),
        )


@dataclass(frozen=True, eq=False)
class PlannedSlide:
    """Configurations of a chain along a way."""

    q: NDArray[np.float64]
    """At its places, shape (K, n)."""
    curve: CubicSpline
    """Through them."""


class ArmSlide(Slide):
    """The slide of an arm, whose configurations go on from the present one, each checked, timed within its limits."""

    def __init__(
        self,
        positioner: ArmPositioner,
        paths: PathSearch,
        tip_speed_m_s: float,
        *,
        timer: PathTimer | None,
        limits: JointLimits,
    ) -> None:
        """Move what `positioner` carries.

        Args:
            positioner: What carries the probe.
            paths: Checks the way.
            tip_speed_m_s: Speed limit of the tip in contact.
            timer: Times the way; None for an estimate, by which all joints go on as fast as the slowest can.
            limits: Of the chain's joints.
        """
        self._positioner, self._paths, self._speed = positioner, paths, tip_speed_m_s
        self._timer, self._limits, self._chain = timer, limits, positioner.search.chain

    def move(self, data: mujoco.MjData, way: SurfaceWay, rows: NDArray[np.intp]) -> Motion | str:
        """See `Slide.move`."""
        planned = self.planned(data.qpos[self._chain.columns].copy(), way)
        if isinstance(planned, str):
            return planned
        if self._timer is None:
            timed = self._estimated(planned.q, way)
        else:
            timed = self._timer.time(planned.curve, tip_speed_m_s=self._speed, dt_s=RECORD_DT_S)
        states, tips_m = self._chain.full(timed.q), self._chain.forward(timed.q).tips_m
        data.qpos[:] = states[-1]
        mujoco.mj_fwdPosition(data.model, data)
        return Motion(
            time_s=timed.time_s,
            states=states,
            tips_m=tips_m,
            phases=np.full(len(states), Phase.SWEEP, dtype=np.int8),
            joint_travel_rad=joint_travel_rad(data.model, states),
            passed_rows=tuple(rows_at(tips_m, way.along_m[rows] / way.along_m[-1])),
        )

    @property
    def chain(self) -> Chain:
        """The arm."""
        return self._chain

    def planned(self, q_start: NDArray[np.float64], way: SurfaceWay) -> PlannedSlide | str:
        """A way on the surface, checked, or why there is none.

        Args:
            q_start: The chain's configuration at its beginning, shape (n,).
            way: The way.
        """
        q = self._configurations(q_start, way)
        if isinstance(q, str):
            return q
        checked = self._paths.slide(q, way.places_m, way.beams)
        return PlannedSlide(q, checked.curves[0]) if checked.is_free else checked.reason

    def _configurations(self, q_start: NDArray[np.float64], way: SurfaceWay) -> NDArray[np.float64] | str:
        """Configurations of the chain at the places of a way, shape (K, n), or why there are none.

        They are continued from the present one: to every second place the joints move as little as they can, with a
        slight pull towards the middle of their ranges, and between these they are solved together.
        """
        stations = np.unique(np.append(np.arange(0, len(way.places_m), EVERY), len(way.places_m) - 1))
        carried = [q_start]
        for station in stations[1:]:
            found = self._descend(carried[-1][None], way, station[None], CENTRING)
            if not _is_there(found).all():
                return "The arm cannot keep the probe on the surface all the way."
            carried.append(found.q[0])
        at = np.arange(len(way.places_m))
        seeds = np.column_stack([np.interp(at, stations, column) for column in np.array(carried).T])
        found = self._descend(seeds, way, at, 0.0)
        if not _is_there(found).all():
            return "The arm cannot keep the probe on the surface all the way."
        return np.vstack([q_start, found.q[1:]])

    def _descend(self, q: NDArray[np.float64], way: SurfaceWay, at: NDArray[np.intp], gain: float) -> Descent:
        return descend(
            self._chain, q, way.places_m[at], way.beams[at], centring_gain=gain, max_steps=20,
            position_tolerance_m=LINE_TOLERANCE_M, angle_tolerance_rad=SLIDE_TILT_RAD,
        )  # fmt: skip

    def _estimated(self, q: NDArray[np.float64], way: SurfaceWay) -> Trajectory:
        """The way in the time that its tip and the slowest of its joints need, evenly along it."""
        turns = np.abs(np.diff(q, axis=0)).sum(axis=0)
        seconds = max(
            way.along_m[-1] / self._speed, float(self._limits.rest_to_rest_s(turns).max(initial=0.0))
        )
        return Trajectory(seconds * way.along_m / way.along_m[-1], q, np.zeros_like(q))


def _is_there(found: Descent) -> NDArray[np.bool_]:
    return (found.distance_m <= LINE_TOLERANCE_M) & (found.angle_rad <= SLIDE_TILT_RAD)


def rows_at(tips_m: NDArray[np.float64], shares: NDArray[np.float64]) -> list[int]:
    """The states in which the tip has come a share of its way, the last one for the whole."""
    gone_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tips_m, axis=0), axis=1))])
    rows = [int(np.argmin(np.abs(gone_m - share * gone_m[-1]))) for share in shares]
    return [len(tips_m) - 1 if share >= 1.0 else row for row, share in zip(rows, shares, strict=True)]

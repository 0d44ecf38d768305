"""The plan of a motion: configurations of an arm in time, and what each is for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.motion.timing import Trajectory

from .motion import Phase


@dataclass(frozen=True, eq=False)
class Plan:
    """What the arm is to do: T configurations of its chain in time, and what they are for."""

    time_s: NDArray[np.float64]
    """Time since the motion began [s], shape (T,)."""
    q: NDArray[np.float64]
    """Positions of the chain's joints [rad or m], shape (T, n_joints)."""
    speed: NDArray[np.float64]
    """Their speeds [rad/s or m/s], shape (T, n_joints)."""
    phases: NDArray[np.int8]
    """The `Phase` of each configuration, shape (T,)."""

    @classmethod
    def of(cls, parts: list[tuple[Phase, Trajectory]]) -> Plan:
        """The plan of some parts one after the other, each of which begins where the one before ended."""
        start_s, times_s, phases = 0.0, [], []
        for phase, part in parts:
            times_s.append(start_s + part.time_s)
            phases.append(np.full(len(part.time_s), int(phase), dtype=np.int8))
            start_s += float(part.time_s[-1])
        time_s = np.concatenate(times_s)
        # A part begins with the state that the one before ended with, which is kept once.
        is_new = np.r_[True, np.diff(time_s) > 0.0]
        q, speed = (np.vstack([getattr(part, name) for _, part in parts])[is_new] for name in ("q", "speed"))
        return cls(time_s[is_new], q, speed, np.concatenate(phases)[is_new])

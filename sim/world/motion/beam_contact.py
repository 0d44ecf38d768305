"""Contact of a flat face that stands across its beam with an organ that may lie elsewhere than planned, and move.

A flat round face without friction is pushed back along its own axis, and in full contact with a half-space its force
depends on how deep its middle is, whatever its tilt: the tilt makes a moment alone. So one number tells the contact,
how far the tip is along the beam beyond where the beam crosses the surface at rest, and a spring of that place and a
damper make the force.
"""

from __future__ import annotations

from typing import Protocol

import mujoco
import numpy as np

from sim.world.frames import rigid_inverse
from sim.world.ik.chain import Array
from sim.world.scene.scene import Group

REACH_M = 0.06
"""A tip is looked for at most so deep below the surface [m]; the probe is longer than that."""
RESTART_M = 1e-7
"""A ray that began inside the organ goes on this far behind where it left it [m]."""
FASTEST_M_S, MOST_ASLEEP = 2.0, 5
"""Before the organ, contact is looked for again when the tip could have got there at this speed, and at the latest
after so many steps: from the side it may be nearer."""


class MovingOrgan(Protocol):
    """Where an organ truly is at any time, and how stiff it is under the face."""

    @property
    def is_moving(self) -> bool:
        """Whether it moves while time passes."""
        ...

    def T_world_rest(self, time_s: float) -> Array:
        """Where it is, as the map from where it was planned to the world, shape (4, 4)."""
        ...

    def stiffness_n_m(self, T_rest_touch: Array) -> float:
        """The spring under a face that first touched at a frame of the tip, rest frame, shape (4, 4) [N/m].

        Raises:
            TissueError: The face cannot be pressed on the organ there.
        """
        ...


class BeamContact:
    """The contact of one probe with one organ, step by step; holds how it was in the last one."""

    def __init__(
        self,
        model: mujoco.MjModel,
        organ: MovingOrgan,
        *,
        damping_n_s_m: float,
        stiffness_n_m: float,
        dt_s: float,
    ) -> None:
        """Nothing is touched yet.

        Args:
            model: Has the organ's mesh where it was planned, in a geom group of its own.
            organ: Where it truly is.
            damping_n_s_m: Damper beside the spring [N s/m].
            stiffness_n_m: Spring until the organ is asked for that of a place [N/m].
            dt_s: Time of a step [s].
        """
        self.organ, self._model, self._damping_n_s_m, self._dt_s = organ, model, damping_n_s_m, dt_s
        self._group = np.zeros(mujoco.mjNGROUP, dtype=np.uint8)
        self._group[int(Group.ORGAN)] = 1
        self._geom, self._normal = np.empty(1, np.int32), np.empty(3)
        self.stiffness_n_m = stiffness_n_m
        """The spring under the face [N/m]."""
        self.time_s = 0.0
        """Time since the procedure began, which whoever steps the arm sets [s]."""
        self.depth_m = -np.inf
        """How far the tip is beyond the surface along its beam [m]; below 0 it is before it."""
        self.force_n = 0.0
        """The force on the tip [N]."""
        self._n_asleep = 0
        self.T_rest_tip = np.eye(4)
        """Where the tip is, rest frame, shape (4, 4); about the beam it is turned anyhow."""

    @property
    def T_rest_touch(self) -> Array:
        """Where the tip's beam crosses the surface, rest frame, shape (4, 4)."""
        T = self.T_rest_tip.copy()
        T[:3, 3] -= self.depth_m * T[:3, 2]
        return T

    def force_along_beam_n(self, data: mujoco.MjData, tip: Array, beam: Array, tip_m_s: Array) -> float:
        """See `TipContact.force_along_beam_n`."""
        if self._n_asleep > 0:
            self._n_asleep -= 1
            return 0.0
        T_world_rest = self.organ.T_world_rest(self.time_s)
        T_rest_world = rigid_inverse(T_world_rest)
        tip_rest = T_rest_world[:3, :3] @ tip + T_rest_world[:3, 3]
        beam_rest = T_rest_world[:3, :3] @ beam
        self.T_rest_tip[:3, 2], self.T_rest_tip[:3, 3] = beam_rest, tip_rest
        self.depth_m = self._depth_m(data, tip_rest, beam_rest)
        self._n_asleep = int(min(max(-self.depth_m / (FASTEST_M_S * self._dt_s), 0.0), MOST_ASLEEP))
        self.force_n = 0.0
        if self.depth_m > 0.0:
            if self.organ.is_moving:
                before = self.organ.T_world_rest(self.time_s - self._dt_s)
                organ_m = (T_world_rest - before)[:3] @ np.append(tip_rest, 1.0)
                tip_m_s = tip_m_s - organ_m / self._dt_s
            spring_n = self.stiffness_n_m * self.depth_m
            self.force_n = max(0.0, spring_n + self._damping_n_s_m * float(beam @ tip_m_s))
        return self.force_n

    def _depth_m(self, data: mujoco.MjData, tip: Array, beam: Array) -> float:
        """How far the tip is beyond the first surface that a ray along its beam enters [m]."""
        along_m = -REACH_M
        while True:
            start_m = tip + along_m * beam
            step_m = mujoco.mj_ray(
                self._model, data, start_m, beam, self._group, 1, -1, self._geom, self._normal
            )
            if step_m < 0.0:
                return -np.inf
            along_m += step_m
            if self._normal @ beam < 0.0:
                return -along_m
            along_m += RESTART_M

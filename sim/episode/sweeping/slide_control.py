"""Force control along a way: servos follow a timed way over the organ and are shifted along the beam to hold a force.

The servos are sent to q(t) + g(t) s, with q the way at the depth at which the force is expected, g how the joints move
for a way along the beam, and s a shift that goes at the speed

    ds/dt = (F_wanted - F) / (k tau)

as in `sim.world.motion.force_control`: admittance control with a damper of k tau, with the way itself fed forward.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sim.world.ik.chain import Chain
from sim.world.motion.beam_contact import BeamContact
from sim.world.motion.force_control import PRESS_ACCELERATION_M_S2, TIME_CONSTANT_S, ForceGoal
from sim.world.motion.timing import Trajectory

Array = NDArray[np.float64]
MOST_SHIFT_M = 0.01
"""The servos are shifted by no more than this from the way [m]: farther, the joints' ways are no longer straight."""
DAMPING = 1e-3
"""Of the least squares by which joints move along the beam [m]: near singular configurations they stay bounded."""


def along_beam(chain: Chain, q: Array) -> Array:
    """How the joints move for a way of the tip along its beam, whose direction is kept [rad/m or 1], shape (T, n).

    Args:
        chain: The arm.
        q: Configurations, shape (T, n).
    """
    state = chain.forward(q)
    jacobian = chain.jacobian(state)
    wanted = np.zeros((len(q), 5))
    wanted[:, :3] = state.beams
    square = jacobian @ jacobian.transpose(0, 2, 1) + DAMPING**2 * np.eye(5)
    return np.einsum("tij,ti->tj", jacobian, np.linalg.solve(square, wanted[:, :, None])[:, :, 0])


class SlideControl:
    """Sends servos along a way under a force; holds how that went."""

    def __init__(
        self, chain: Chain, timed: Trajectory, contact: BeamContact, goal: ForceGoal, *, dt_s: float
    ) -> None:
        """Begin at the way's beginning, with the probe in contact.

        Args:
            chain: The arm.
            timed: The way at the depth at which the force is expected.
            contact: Tells the force.
            goal: The force, and the speed limit of the tip along the beam.
            dt_s: Time of a step [s].
        """
        n_steps = int(np.ceil(timed.time_s[-1] / dt_s))
        time_s = dt_s * np.arange(1, n_steps + 1)
        shift = along_beam(chain, timed.q)
        self._q, self._speed, self._shift = (
            np.column_stack([np.interp(time_s, timed.time_s, column) for column in part.T])
            for part in (timed.q, timed.speed, shift)
        )
        self._contact, self._goal, self._dt_s = contact, goal, dt_s
        self.shift_m, self._shift_m_s = 0.0, 0.0
        self.sent_q = list[Array]()
        """Where the servos were sent, step by step, shape (n,) each."""
        self.force_n = list[float]()
        """The force before each step [N]."""

    def commands(self) -> Iterator[tuple[Array, Array]]:
        """Where the servos are sent, and how fast, step after step."""
        for q, speed, shift in zip(self._q, self._speed, self._shift, strict=True):
            self._follow_force()
            self.force_n.append(self._contact.force_n)
            self.sent_q.append(q + self.shift_m * shift)
            yield self.sent_q[-1], speed + self._shift_m_s * shift

    def _follow_force(self) -> None:
        """Move the shift by one step."""
        goal, contact = self._goal, self._contact
        wanted_m_s = (goal.force_n - contact.force_n) / (contact.stiffness_n_m * TIME_CONSTANT_S)
        wanted_m_s = float(np.clip(wanted_m_s, -goal.speed_m_s, goal.speed_m_s))
        most_m_s = PRESS_ACCELERATION_M_S2 * self._dt_s
        self._shift_m_s += float(np.clip(wanted_m_s - self._shift_m_s, -most_m_s, most_m_s))
        before_m = self.shift_m
        self.shift_m = float(np.clip(before_m + self._shift_m_s * self._dt_s, -MOST_SHIFT_M, MOST_SHIFT_M))
        self._shift_m_s = (self.shift_m - before_m) / self._dt_s

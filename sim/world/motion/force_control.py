"""Force control: a probe goes down along its beam until it meets the organ, and on until it presses with its force.

The servos are sent to a place s on the line of the beam, which moves at the speed

    ds/dt = (F_wanted - F) / (k tau),

with k the spring of the organ at that place: the force then comes near the wanted one as exp(-t / tau), and follows an
organ that breathes. That is admittance control with a damper of k tau, which only the tip's speed limit bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from sim.world.errors import TissueError
from sim.world.ik.chain import Array, Chain
from sim.world.ik.damped_least_squares import descend

from .beam_contact import BeamContact
from .path_search import LINE_SLACK, LINE_SPACING_M, LINE_TOLERANCE_M, LINE_TOLERANCE_RAD, MAX_LINE_TURN_RAD

FINE_M = 0.0005
"""A line is followed straight between configurations this far apart [m]."""
ACCELERATION_M_S2, PRESS_ACCELERATION_M_S2 = 0.5, 5.0
"""Of the place on the line: before the organ is met, and after."""
SLOWEST_M_S = 0.001
"""So fast the search for contact ends, at least [m/s]."""
TIME_CONSTANT_S = 0.02
"""tau: at 12 ms the force of some postures of the embedded arm keeps swinging by a hundredth."""
REACHED_SHARE = 0.02
"""The force is reached within this share of it, and from then on it is held."""
MOST_PRESSING_S = 5.0
"""From contact to the wanted force it takes no longer, or it is not reached."""
SAME_STIFFNESS_SHARE, MOST_ROUNDS = 0.01, 3
"""Where the face has slid to a place whose spring differs by more than this share, it is held again, so many times."""


@dataclass(frozen=True, eq=False)
class BeamLine:
    """Configurations of a chain whose tip lies on a straight line along its beam."""

    start_m: float
    """Where it begins, along the beam from where the organ is expected [m]."""
    q: Array
    """`FINE_M` apart, shape (K, n)."""
    reason: str = ""
    """Why it ends before it was to, as a sentence."""

    @property
    def end_m(self) -> float:
        """Where it ends [m]."""
        return self.start_m + FINE_M * (len(self.q) - 1)

    def at(self, along_m: float) -> tuple[Array, Array]:
        """The configuration at a place, shape (n,), and how fast it changes along the line [rad/m or 1], likewise."""
        share = min(max((along_m - self.start_m) / FINE_M, 0.0), len(self.q) - 1.0)
        row = min(int(share), len(self.q) - 2)
        way = self.q[row + 1] - self.q[row]
        return self.q[row] + (share - row) * way, way / FINE_M

    def way_up(self, along_m: float) -> Array:
        """Configurations from a place to the line's beginning, shape (M, n)."""
        rows = np.arange(0.0, along_m - self.start_m, LINE_SPACING_M) + self.start_m
        return np.array([self.at(each)[0] for each in (*rows, along_m)])[::-1]


def beam_line(
    chain: Chain,
    T_world_tip: Array,
    seeds: tuple[Array, Array],
    *,
    above_m: float,
    below_m: float,
    touching: Callable[[Array], str],
) -> BeamLine:
    """The line along a beam from above a place to below it, as far as the arm can follow.

    Args:
        chain: Follows.
        T_world_tip: The place and the direction of the beam, shape (4, 4).
        seeds: Configurations near those above the place and at it, shape (n,) each.
        above_m: How far above the place the line begins [m].
        below_m: How far below it it ends [m].
        touching: What touches in a configuration, as a sentence; empty where nothing does.
    """
    along_m = np.arange(-above_m, below_m + LINE_SPACING_M, LINE_SPACING_M)
    tips_m = T_world_tip[:3, 3] + along_m[:, None] * T_world_tip[:3, 2]
    share = (along_m[:, None] + above_m) / max(above_m, LINE_SPACING_M)
    found = descend(
        chain,
        np.clip(seeds[0] + share * (seeds[1] - seeds[0]), chain.low, chain.high),
        tips_m,
        np.tile(T_world_tip[:3, 2], (len(along_m), 1)),
        centring_gain=0.0,
        position_tolerance_m=LINE_TOLERANCE_M,
        angle_tolerance_rad=LINE_TOLERANCE_RAD,
    )
    is_off = (found.distance_m > LINE_SLACK * LINE_TOLERANCE_M) | (
        found.angle_rad > LINE_SLACK * LINE_TOLERANCE_RAD
    )
    is_off[1:] |= np.abs(np.diff(found.q, axis=0)).max(axis=1) > MAX_LINE_TURN_RAD
    n_followed = int(np.argmax(is_off)) if is_off.any() else len(is_off)
    reason = "" if n_followed == len(is_off) else "The arm's joints end there."
    for index, q in enumerate(found.q[:n_followed]):
        if touched := touching(q):
            n_followed, reason = index, touched
            break
    if n_followed < 2:
        return BeamLine(-above_m, found.q[:n_followed], reason)
    curve = CubicSpline(along_m[:n_followed], found.q[:n_followed])
    n_fine = round((along_m[n_followed - 1] + above_m) / FINE_M) + 1
    return BeamLine(-above_m, curve(FINE_M * np.arange(n_fine) - above_m), reason)


@dataclass(frozen=True, kw_only=True)
class ForceGoal:
    """What a probe is sent down for."""

    force_n: float
    """Force to press with [N]."""
    search_m: float
    """How far below where the organ is expected it is looked for [m]."""
    speed_m_s: float
    """Speed limit of the tip [m/s]."""
    settle_s: float
    """How long the force is held [s]."""
    wait_s: Callable[[float], float] = lambda time_s: 0.0
    """How long it is held further at a time [s], until the organ is where it is to be sensed [s]."""


class ForceControl:
    """Brings a tip down a line to its force; holds how that went."""

    def __init__(self, line: BeamLine, contact: BeamContact, goal: ForceGoal, *, dt_s: float) -> None:
        """Begin at the line's beginning.

        Args:
            line: Where the tip goes.
            contact: Tells what it meets.
            goal: What it is sent for.
            dt_s: Time of a step [s].
        """
        self.line, self._contact, self._goal, self._dt_s = line, contact, goal, dt_s
        self.along_m, self._speed_m_s = line.start_m, 0.0
        self.reason = ""
        """Why there is no contact with the wanted force, as a sentence; empty where there is."""
        self.held_s = 0.0
        """For how long the force has been held since it was reached [s]."""

    def commands(self) -> Iterator[tuple[Array, Array]]:
        """Where the servos are sent, and how fast, step after step, down to the force and until it was held."""
        yield from self._search()
        for _ in range(MOST_ROUNDS if not self.reason else 0):
            try:
                stiffness_n_m = self._contact.organ.stiffness_n_m(self._contact.T_rest_touch)
            except TissueError as error:
                self.reason = f"The organ does not yield to the probe there: {error}."
                return
            change = abs(stiffness_n_m / self._contact.stiffness_n_m - 1.0)
            if self.held_s > 0.0 and change <= SAME_STIFFNESS_SHARE:
                return
            self._contact.stiffness_n_m = stiffness_n_m
            yield from self._press()
            if self.reason:
                return
            yield from self.hold(self._goal.settle_s)
            yield from self.hold(self._goal.wait_s(self._contact.time_s))

    def hold(self, seconds: float) -> Iterator[tuple[Array, Array]]:
        """Commands that hold the force for some time [s]."""
        for _ in range(round(seconds / self._dt_s)):
            self.held_s += self._dt_s
            yield self._pressed_on()

    def _search(self) -> Iterator[tuple[Array, Array]]:
        goal, line, contact = self._goal, self.line, self._contact
        end_m = min(goal.search_m, line.end_m)
        yield self._moved(0.0)
        if contact.depth_m > 0.0:
            self.reason = "The probe would have to come down from within the organ."
            return
        while contact.depth_m <= 0.0:
            left_m = end_m - self.along_m
            if left_m <= 0.0:
                self.reason = (
                    f"The probe met no organ from {-line.start_m * 1e3:g} mm above to {end_m * 1e3:g} mm below where "
                    "its surface was expected."
                )
                if line.end_m < goal.search_m:
                    self.reason += f" {line.reason}"
                return
            faster_m_s = self._speed_m_s + ACCELERATION_M_S2 * self._dt_s
            stopping_m_s = max(SLOWEST_M_S, np.sqrt(2.0 * ACCELERATION_M_S2 * left_m))
            yield self._moved(min(faster_m_s, goal.speed_m_s, stopping_m_s))

    def _press(self) -> Iterator[tuple[Array, Array]]:
        """Commands from contact to the force."""
        goal, line, contact = self._goal, self.line, self._contact
        for _ in range(round(MOST_PRESSING_S / self._dt_s)):
            if abs(contact.force_n - goal.force_n) <= REACHED_SHARE * goal.force_n:
                return
            if self.along_m >= line.end_m:
                break
            yield self._pressed_on()
        self.reason = (
            f"The probe pressed with {contact.force_n:.2g} N, {contact.depth_m * 1e3:.1f} mm below the surface, "
            f"where {goal.force_n:.2g} N were wanted. {line.reason}"
        ).strip()

    def _pressed_on(self) -> tuple[Array, Array]:
        contact, goal = self._contact, self._goal
        wanted_m_s = (goal.force_n - contact.force_n) / (contact.stiffness_n_m * TIME_CONSTANT_S)
        wanted_m_s = float(np.clip(wanted_m_s, -goal.speed_m_s, goal.speed_m_s))
        most_m_s = PRESS_ACCELERATION_M_S2 * self._dt_s
        return self._moved(
            self._speed_m_s + float(np.clip(wanted_m_s - self._speed_m_s, -most_m_s, most_m_s))
        )

    def _moved(self, speed_m_s: float) -> tuple[Array, Array]:
        """The command of the next step, in which the place on the line moves at a speed."""
        self._speed_m_s = speed_m_s
        along_m = self.along_m + speed_m_s * self._dt_s
        self.along_m = float(np.clip(along_m, self.line.start_m, self.line.end_m))
        self._contact.time_s += self._dt_s
        q, slope = self.line.at(self.along_m)
        return q, slope * speed_m_s

"""A timed path of joints, checked against all limits before anybody is sent it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import WorldError

Array = NDArray[np.float64]

STILL = 1e-6
"""A joint this slow is at rest [rad/s or m/s], and one this near to a limit by rounding is within it [rad or m]."""
SPEED_SLACK = 1e-3
"""Share by which a joint may be faster than its limit, by rounding of times to the nanosecond."""
RAMP_S = 0.4
"""A path that goes on where it was broken off gets to its speed in this time [s]."""


class PathRefusedError(WorldError):
    """A path that no arm may be sent; nothing was sent."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ArmLimits:
    """What n joints may do."""

    low: Array
    """Least positions, -inf where there are none [rad or m], shape (n,)."""
    high: Array
    """Greatest positions, inf where there are none [rad or m], shape (n,)."""
    speed: Array
    """Largest speeds [rad/s or m/s], shape (n,)."""

    def within(self, other: ArmLimits) -> ArmLimits:
        """The limits of both."""
        return ArmLimits(
            low=np.maximum(self.low, other.low),
            high=np.minimum(self.high, other.high),
            speed=np.minimum(self.speed, other.speed),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class TimedPath:
    """Positions and speeds of n joints at T times, at rest at both ends."""

    names: tuple[str, ...]
    """The joints, n of them."""
    time_s: Array
    """Strictly rising from 0 [s], shape (T,)."""
    q: Array
    """[rad or m], shape (T, n)."""
    speed: Array
    """[rad/s or m/s], shape (T, n)."""

    @property
    def duration_s(self) -> float:
        """How long it takes [s]."""
        return float(self.time_s[-1])

    def at(self, time_s: float) -> tuple[Array, Array]:
        """Positions and speeds at a time, on straight lines between the samples, each of shape (n,)."""
        row = int(np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, max(len(self.q) - 2, 0)))
        if len(self.q) == 1 or time_s >= self.time_s[-1]:
            return self.q[-1], np.zeros_like(self.q[-1])
        step_s = self.time_s[row + 1] - self.time_s[row]
        share, rate = (max(time_s, 0.0) - self.time_s[row]) / step_s, (self.q[row + 1] - self.q[row]) / step_s
        return self.q[row] + share * (self.q[row + 1] - self.q[row]), rate

    def check(self, limits: ArmLimits) -> None:
        """Nothing, if the path may be sent to an arm.

        Raises:
            PathRefusedError: A value is not finite, times do not rise, an end is no rest, or a joint passes a limit.
        """
        if not (len(self.time_s) == len(self.q) == len(self.speed) >= 1 and self.q.shape == self.speed.shape):
            raise PathRefusedError("The path's times, positions and speeds are not equally many.")
        if not all(np.isfinite(values).all() for values in (self.time_s, self.q, self.speed)):
            raise PathRefusedError("The path holds a value that is not finite.")
        if self.time_s[0] != 0.0 or (np.diff(self.time_s) <= 0.0).any():
            raise PathRefusedError("The path's times do not rise from 0.")
        if np.abs(self.speed[[0, -1]]).max() > STILL:
            raise PathRefusedError("The path does not begin and end at rest.")
        # Between samples joints go straight: positions are greatest at samples, and speeds are differences.
        between = np.diff(self.q, axis=0) / np.diff(self.time_s)[:, None]
        fastest = np.maximum(np.abs(self.speed), np.abs(np.vstack([between, self.speed[-1:]])))
        low, high = limits.low - STILL, limits.high + STILL
        self._refuse(self.q > high, self.q, limits.high, "would go to {0:.4g}, and ends at {1:.4g}")
        self._refuse(self.q < low, self.q, limits.low, "would go to {0:.4g}, and begins at {1:.4g}")
        too_fast = fastest > limits.speed * (1.0 + SPEED_SLACK) + STILL
        self._refuse(too_fast, fastest, limits.speed, "would move at {0:.4g} a second, and may at {1:.4g}")

    def _refuse(self, is_beyond: NDArray[np.bool_], values: Array, limits: Array, text: str) -> None:
        if not is_beyond.any():
            return
        row, joint = map(int, np.argwhere(is_beyond)[0])
        problem = text.format(values[row, joint], np.broadcast_to(limits, values.shape)[row, joint])
        raise PathRefusedError(
            f"{self.names[joint]} {problem} (rad, or m of a slide), {self.time_s[row]:.2f} s after the start of the "
            "path. Nothing was sent; the limits of the arm's file and those of the controller have to agree."
        )

    def begun_at(self, q: Sequence[float] | Array, *, farthest: float) -> TimedPath:
        """The path for an arm that stands near its beginning: itself, or one that begins slowly from there.

        Args:
            q: Where the joints are, shape (n,).
            farthest: How far the joint that is farthest off may be from the beginning [rad or m].

        Raises:
            PathRefusedError: It is farther.
        """
        here = np.asarray(q, dtype=np.float64)
        away = float(np.abs(self.q[0] - here).max())
        self._refuse_stranger(away, farthest)
        return self if away <= STILL else self._slowly_from(0, here)

    def rest_from(self, q: Sequence[float] | Array, *, farthest: float) -> TimedPath:
        """What is left of the path for an arm that came to rest near it; it gets to its speed slowly.

        Args:
            q: Where the joints are, shape (n,).
            farthest: How far the joint that is farthest off may be from the path [rad or m].

        Raises:
            PathRefusedError: It is farther.
        """
        here = np.asarray(q, dtype=np.float64)
        away = np.abs(self.q - here).max(axis=1)
        # Of places that the path goes through twice the earlier one is taken, so that nothing is left out.
        row = int(np.argmin(away))
        self._refuse_stranger(float(away[row]), farthest)
        return self._slowly_from(row, here)

    def _refuse_stranger(self, away: float, farthest: float) -> None:
        if not away <= farthest:
            raise PathRefusedError(
                f"The arm stands {away:.3g} (rad, or m of a slide) off its path, and may be {farthest:g}. Bring it "
                "to where it is free by its own controller, and start again."
            )

    def _slowly_from(self, row: int, here: Array) -> TimedPath:
        """The path from a row on, with a ramp: its time s runs as s' = u / RAMP_S, and then as before.

        What the arm is off the path by fades out meanwhile.
        """
        if row == len(self.q) - 1:
            ends = np.stack([here, self.q[-1]])
            return TimedPath(
                names=self.names, time_s=np.array([0.0, RAMP_S]), q=ends, speed=np.zeros_like(ends)
            )
        path_s = self.time_s[row:] - self.time_s[row]
        in_ramp = path_s < RAMP_S / 2.0  # the ramp takes half of its time of the path
        new_s = np.where(in_ramp, np.sqrt(2.0 * RAMP_S * path_s), path_s + RAMP_S / 2.0)
        pace = np.where(in_ramp, new_s / RAMP_S, 1.0)[:, None]
        fading = np.clip(1.0 - new_s / min(RAMP_S, float(new_s[-1])), 0.0, 1.0)[:, None] ** 2
        return TimedPath(
            names=self.names,
            time_s=new_s,
            q=self.q[row:] + (here - self.q[row]) * fading,
            speed=self.speed[row:] * pace,
        )

"""A simulated arm with its controller, in time steps of its own clock: what it is told, what it does, what it notes.

It follows a path exactly but for an error of its own, and comes to rest along the path as soon as nobody is heard.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .controller import ArmState, Status
from .messages import BEAT, FOLLOW, HELLO, STOP, BrokenMessageError, path_of
from .timed_path import ArmLimits, PathRefusedError, TimedPath

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedArmSettings:
    """What is simulated."""

    names: tuple[str, ...]
    """The joints, n of them."""
    limits: ArmLimits
    """What they may do; a path beyond them is refused."""
    start_q: Array
    """Where they are at the beginning [rad or m], shape (n,)."""
    error_q: Array
    """What the arm is off the end of each path [rad or m], shape (n,)."""
    tick_s: float = 0.005
    """A time step [s]."""
    watchdog_s: float = 0.06
    """The arm begins to stop when nobody was heard for so long [s]."""
    brake_s: float = 0.03
    """It is at rest so much later [s]: together less than 100 ms."""
    start_tolerance: float = 0.02
    """Farthest that a path may begin from where the arm is [rad or m]."""


class SimulatedArm:
    """An arm whose clock is `tick`."""

    def __init__(self, settings: SimulatedArmSettings) -> None:
        """Rest where the settings say."""
        self.settings, self.now_s = settings, 0.0
        self.q, self.speed = settings.start_q.copy(), np.zeros(len(settings.names))
        self._path: TimedPath | None = None
        self._path_s, self._pace, self._is_braking = 0.0, 1.0, False
        self._goal, self._status, self._text = 0, Status.IDLE, ""
        self._heard_s, self._seen, self._off = -np.inf, 0, np.zeros_like(self.q)
        self._lowest, self._highest, self._fastest = self.q.copy(), self.q.copy(), np.zeros_like(self.q)
        self._longest_unheard_s, self._n_stops = 0.0, 0

    @property
    def state(self) -> ArmState:
        """Where the arm is, and what became of its path."""
        return ArmState(
            stamp_s=self.now_s, q=self.q.copy(), speed=self.speed.copy(), goal=self._goal, status=self._status,
            text=self._text, seen=self._seen,
        )  # fmt: skip

    @property
    def record(self) -> dict[str, Any]:
        """How far, how fast and how long unheard the arm has moved since the beginning, as plain data."""
        return {
            "lowest": self._lowest.tolist(),
            "highest": self._highest.tolist(),
            "fastest": self._fastest.tolist(),
            "longest_unheard_s": self._longest_unheard_s,
            "n_stops": self._n_stops,
            "is_moving": bool(np.abs(self.speed).max() > 0.0),
        }

    def hear(self, message: Mapping[str, Any]) -> None:
        """Do what a message says; one that is broken, or was heard before, does nothing."""
        if message["op"] == HELLO:
            self._seen = n if isinstance(n := message.get("n"), int) else self._seen
        elif message["op"] == BEAT:
            self._heard_s = self.now_s
        elif message["op"] == STOP:
            self._brake("It was told to stop.")
        elif message["op"] == FOLLOW:
            goal = message.get("goal")
            if not isinstance(goal, int) or goal <= self._goal or self._path is not None:
                return
            try:
                path = path_of(message.get("trajectory"))
                self._begin(goal, path)
            except BrokenMessageError as error:
                self._goal, self._status, self._text = goal, Status.REFUSED, f"{error}."

    def tick(self) -> None:
        """Let a time step pass."""
        own = self.settings
        self.now_s += own.tick_s
        before = self.q
        if self._path is not None:
            if self.now_s - self._heard_s > own.watchdog_s:
                self._brake("Nobody was heard any more.")
            self._move(self._path)
        self.speed = (self.q - before) / own.tick_s
        if np.abs(self.speed).max() > 0.0:
            self._lowest, self._highest = np.minimum(self._lowest, self.q), np.maximum(self._highest, self.q)
            self._fastest = np.maximum(self._fastest, np.abs(self.speed))
            self._longest_unheard_s = max(self._longest_unheard_s, self.now_s - self._heard_s)

    def _begin(self, goal: int, path: TimedPath) -> None:
        own = self.settings
        self._goal, self._text = goal, ""
        try:
            if path.names != own.names:
                raise PathRefusedError("The path is of other joints.")
            path.check(own.limits)
            away = float(np.abs(path.q[0] - self.q).max())
            if not away <= own.start_tolerance:
                raise PathRefusedError(
                    f"The path begins {away:.3g} (rad, or m of a slide) from where the arm is."
                )
        except PathRefusedError as error:
            self._status, self._text = Status.REFUSED, str(error)
            return
        self._path, self._status, self._heard_s = path, Status.FOLLOWING, self.now_s
        self._path_s, self._pace, self._is_braking = 0.0, 1.0, False
        self._off = self.q - path.q[0]

    def _brake(self, text: str) -> None:
        if self._path is not None and not self._is_braking:
            self._is_braking, self._text = True, text

    def _move(self, path: TimedPath) -> None:
        own = self.settings
        if self._is_braking:
            self._pace = max(0.0, self._pace - own.tick_s / own.brake_s)
        self._path_s = min(self._path_s + self._pace * own.tick_s, path.duration_s)
        share = self._path_s / path.duration_s if path.duration_s > 0.0 else 1.0
        blend = share * share * (3.0 - 2.0 * share)
        self.q = path.at(self._path_s)[0] + (1.0 - blend) * self._off + blend * own.error_q
        if self._path_s >= path.duration_s:
            self._path, self._status = None, Status.DONE
        elif self._pace == 0.0:
            self._path, self._status = None, Status.STOPPED
            self._n_stops += 1

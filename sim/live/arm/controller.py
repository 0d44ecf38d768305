"""The interface of what drives an arm: it says what the arm is and where, and follows a path until it is done.

It asks for no more than a ros2_control JointTrajectoryController offers: joint states, and one trajectory at a time.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from sim.closeable import Closeable
from sim.world.errors import WorldError

from .timed_path import ArmLimits, TimedPath


class ControllerError(WorldError):
    """The controller cannot be reached, is silent, or does not do what it was sent; the arm stands still."""


class Status(StrEnum):
    """What a controller does about the path that it was sent last."""

    IDLE = "idle"
    """It was sent none."""
    FOLLOWING = "following"
    DONE = "done"
    """It arrived at the end."""
    STOPPED = "stopped"
    """It came to rest on the way: nobody was heard any more, or it was told to."""
    REFUSED = "refused"
    """It did not begin."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ArmState:
    """Where an arm really is."""

    stamp_s: float
    """By the controller's clock [s]."""
    q: NDArray[np.float64]
    """[rad or m], shape (n,)."""
    speed: NDArray[np.float64]
    """[rad/s or m/s], shape (n,)."""
    goal: int = 0
    """Number of the path that it was sent last; 0 for none."""
    status: Status = Status.IDLE
    """What it does about that path."""
    text: str = ""
    """Why it stopped or refused, as a sentence."""
    seen: int = 0
    """Number of the question that the controller heard last; 0 where it was asked none."""


class ArmController(Closeable):
    """An arm that can be sent paths. It is for one thread."""

    names: tuple[str, ...]
    """The joints, from the base on."""
    limits: ArmLimits
    """What the controller allows them."""

    @abstractmethod
    def state(self) -> ArmState:
        """Where the arm is now.

        Raises:
            ControllerError: It does not say.
        """

    @abstractmethod
    def follow(
        self, path: TimedPath, watch: Callable[[ArmState], bool] = lambda state: True
    ) -> list[ArmState]:
        """Send a path and wait until the arm rests, whatever became of it.

        Args:
            path: Checked, and beginning where the arm is.
            watch: Called with each state; False stops the arm.

        Returns:
            The states on the way, at least one; the last tells what became of the path.

        Raises:
            ControllerError: The arm does not say where it is any more.
        """

"""How fast the arm may move and how long a sensing action takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

MotionKind = Literal["none", "kinematic", "servo"]
"""How the probe gets from pose to pose: it jumps, follows a timed path exactly, or is moved by simulated servos."""


@dataclass(frozen=True, kw_only=True)
class MotionSettings:
    """Speeds of the arm and seconds of a sensing action."""

    joint_speed: float | None = None
    """Speed limit of every joint [rad/s, for slides m/s]; None for the arm's own, see `JointLimits.of_arm`."""
    joint_acceleration: float | None = None
    """Acceleration limit of every joint [rad/s^2, for slides m/s^2]; None likewise."""
    tip_speed_m_s: float = 0.25
    """Speed limit of the probe's tip in a transfer: the reduced speed of ISO 10218-1, for robots near people."""
    approach_speed_m_s: float = 0.05
    """Speed limit of the tip when it lifts off the organ and comes down on it."""
    sensing_s: float = 2.0
    """Time that a sensing action takes once the probe is in place; adds to the procedure time."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        for name in ("joint_speed", "joint_acceleration", "tip_speed_m_s", "approach_speed_m_s"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}={value}: must be a positive, finite number.")
        if not (np.isfinite(self.sensing_s) and self.sensing_s >= 0.0):
            raise ValueError(f"sensing_s={self.sensing_s}: must be 0 or a positive, finite number.")

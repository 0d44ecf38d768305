"""How fast the arm may move, and how soft the organ is that the probe touches."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .arm import MODELS_DIR

PANDA_SPEED = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
"""Published joint speeds of the Franka Emika Panda, the embedded arm [rad/s]."""
PANDA_ACCELERATION = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
"""Published joint accelerations of the same [rad/s^2]."""
OTHER_SPEED, OTHER_ACCELERATION = 1.0, 4.0
"""For arms whose limits nobody stated, since MJCF has no place for them: slow for any arm of today [rad/s, rad/s^2]."""
SLIDE_SHARE = 0.25
"""Slides get this share of those numbers, in m/s and m/s^2."""


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


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the joints of a chain, from the base on."""

    speed: NDArray[np.float64]
    """[rad/s or m/s], shape (n,)."""
    acceleration: NDArray[np.float64]
    """[rad/s^2 or m/s^2], shape (n,)."""

    @classmethod
    def of_arm(
        cls, arm_path: Path, is_slide: NDArray[np.bool_], settings: MotionSettings | None = None
    ) -> JointLimits:
        """Published limits for the embedded arm, `OTHER_SPEED` and `OTHER_ACCELERATION` for any other.

        Args:
            arm_path: MJCF file of the arm.
            is_slide: Which joints of the chain slide, shape (n,).
            settings: May name one limit for all joints.
        """
        settings = settings or MotionSettings()
        is_panda = arm_path == MODELS_DIR / "arm.xml" and len(is_slide) == len(PANDA_SPEED)
        share = np.where(is_slide, SLIDE_SHARE, 1.0)
        speed = np.array(PANDA_SPEED) if is_panda else OTHER_SPEED * share
        acceleration = np.array(PANDA_ACCELERATION) if is_panda else OTHER_ACCELERATION * share
        if settings.joint_speed is not None:
            speed = np.full(len(is_slide), settings.joint_speed)
        if settings.joint_acceleration is not None:
            acceleration = np.full(len(is_slide), settings.joint_acceleration)
        return cls(speed, acceleration)

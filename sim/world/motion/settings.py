"""Settings of the motion: how fast the arm moves, how stiff servos and organ are, and how hard the probe may press."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim.errors import FieldError

MotionKind = Literal["none", "kinematic", "servo"]
"""How the probe gets from pose to pose: it jumps, follows a timed path exactly, or is moved by simulated servos."""

LIVER_YOUNG_PA = 4100.0
"""Young's modulus of healthy liver, mean of 530 people by transient elastography (4.1 kPa, standard deviation 0.89):
Fung et al., Defining normal liver stiffness range in a normal healthy Chinese population, PLoS ONE 8(12), 2013."""
MOST_PRESS_M = 0.04
"""Deeper than this no probe is sent into a spring [m]."""
FACE_M = 0.008
"""Radius of the face of a probe that names none, as of the embedded one."""
POISSON = 0.5
"""Soft tissue hardly changes its volume."""


def punch_stiffness_n_m(young_pa: float, radius_m: float = FACE_M, poisson: float = POISSON) -> float:
    """Stiffness 2 E a / (1 - nu^2) of an elastic half-space under a flat round punch of radius a (Sneddon, 1965)."""
    return 2.0 * young_pa * radius_m / (1.0 - poisson**2)


@dataclass(frozen=True, kw_only=True)
class MotionSettings:
    """Speeds of the arm and seconds of a sensing action."""

    joint_speed: float | None = None
    """Speed limit of every joint [rad/s, for slides m/s]; None for the arm's own, see `JointLimits.of_arm`."""
    joint_acceleration: float | None = None
    """Acceleration limit of every joint [rad/s^2, for slides m/s^2]; None likewise."""
    tip_speed_m_s: float = 0.25
    """Speed limit of the probe's tip in a transfer [m/s]: the reduced speed of ISO 10218-1, for robots near people."""
    approach_speed_m_s: float = 0.05
    """Speed limit of the tip when it lifts off the organ and comes down on it [m/s]."""
    sensing_s: float = 2.0
    """Time that a sensing action takes once the probe is in place [s], which adds to the time of the procedure."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        for name in ("joint_speed", "joint_acceleration", "tip_speed_m_s", "approach_speed_m_s"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}={value}: must be a positive, finite number.")
        if not (np.isfinite(self.sensing_s) and self.sensing_s >= 0.0):
            raise ValueError(f"sensing_s={self.sensing_s}: must be 0 or a positive, finite number.")


@dataclass(frozen=True, kw_only=True)
class ServoSettings:
    """The simulated arm and what it touches."""

    stiffness_n_m: float | None = None
    """Spring of the organ's surface under the tip [N/m]; None for that of healthy liver under a flat disc with the area
    of the probe's face, which is 87 for the embedded probe."""
    damping_n_s_m: float = 2.0
    """Damper beside it [N s/m]. It is our own choice: it calms the contact within some hundredths of a second."""
    force_limit_n: float = 5.0
    """Contact force at which the arm stops [N]."""
    press_m: float = 0.002
    """How far below the surface the tip is sent [m]: a probe that only touches presses nothing."""
    press_n: float | None = None
    """Contact force at which the probe stops [N], in place of that depth; None for the depth, or, where the organ is
    not as planned, for the force that the spring has there."""
    settle_s: float = 0.4
    """The arm holds still this long before the reading is taken [s]."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        for name in ("stiffness_n_m", "force_limit_n"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}={value}: must be a positive, finite number.")
        for name in ("damping_n_s_m", "settle_s"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name}={value}: must be 0 or a positive, finite number.")
        if not 0.0 <= self.press_m <= MOST_PRESS_M:
            raise ValueError(f"press_m={self.press_m}: from 0 to {MOST_PRESS_M:g} m.")
        if self.press_n is not None and not 0.0 < self.press_n < self.force_limit_n:
            raise FieldError(
                "press_n",
                self.press_n,
                f"must be above 0 and below the {self.force_limit_n:g} N of `force_limit_n`, at which the arm stops.",
            )

    def pressing_n(self, stiffness_n_m: float) -> float:
        """The force to press with on a spring [N].

        Args:
            stiffness_n_m: The spring under the tip [N/m].

        Raises:
            FieldError: There is none, it is beyond the limit, or the spring gives way too far to it.
        """
        force_n = stiffness_n_m * self.press_m if self.press_n is None else self.press_n
        if self.press_n is None and not 0.0 < force_n < self.force_limit_n:
            raise FieldError(
                "press_mm",
                1e3 * self.press_m,
                f"makes {force_n:.3g} N on a spring of {stiffness_n_m:.3g} N/m, and where the organ is not as planned "
                f"the probe stops at a force, more than 0 and less than the {self.force_limit_n:g} N of "
                "`force_limit_n`: name it (`press_n`).",
            )
        if force_n > stiffness_n_m * MOST_PRESS_M:
            raise FieldError(
                "press_n",
                force_n,
                f"presses a spring of {stiffness_n_m:.3g} N/m {1e3 * force_n / stiffness_n_m:.0f} mm in, and "
                f"{1e3 * MOST_PRESS_M:g} mm are the most: press with at most {stiffness_n_m * MOST_PRESS_M:.2g} N, or "
                "name a stiffer spring (`stiffness_n_m`).",
            )
        return force_n

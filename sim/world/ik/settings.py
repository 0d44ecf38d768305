"""Tolerances and effort of the inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MOST_PADDING_M = 0.03
"""The distance to the organ is known this far around it and farther [m]; beyond, only bounds are."""


@dataclass(frozen=True, kw_only=True)
class IkSettings:
    """Tolerances and effort of the IK."""

    position_tolerance_m: float = 1e-4
    """Largest accepted distance of the tip from the pose [m]."""
    angle_tolerance_rad: float = 2e-3
    """Largest accepted angle between the beam and the pose's normal [rad]."""
    max_iterations: int = 40
    """Most steps of one start."""
    max_restarts: int = 40
    """Most starts after the first, from a fixed set of configurations near the pose."""
    n_compared: int = 6
    """Starts of which the most comfortable answer is taken; the others follow only where all of these fail."""
    start_seed: int = 0
    """Seed of the set of starts, a constant of the algorithm: the same for every seed of an episode."""
    max_step_rad: float = 0.5
    """No joint moves more than this in one step: the cap turns 440 of 500 solved poses into 475."""
    posture_cost: float = 1e-3
    """Weight that keeps the spare joints near the search's answer while mink closes the last of the error."""
    standoff_m: float = 0.04
    """The probe comes from and goes back to this far above the surface, along the normal [m]; 0 leaves that out."""

    padding_m: float = 0.0
    """Room that arm and probe keep from the table and the arm from itself [m], and the arm from the organ beyond the
    3 mm that it keeps anyway; at most `MOST_PADDING_M`."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        for name in ("position_tolerance_m", "angle_tolerance_rad", "max_step_rad"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name}={value}: must be a positive, finite number.")
        if not (np.isfinite(self.standoff_m) and self.standoff_m >= 0):
            raise ValueError(f"standoff_m={self.standoff_m}: must be 0 or a positive, finite number.")
        if not 0.0 <= self.padding_m <= MOST_PADDING_M:
            raise ValueError(f"padding_m={self.padding_m}: must be from 0 to {MOST_PADDING_M} m.")
        if self.max_iterations < 1 or self.max_restarts < 0:
            raise ValueError(
                f"max_iterations={self.max_iterations}, max_restarts={self.max_restarts}: at least 1 and 0."
            )
        if self.n_compared < 1 or self.start_seed < 0:
            raise ValueError(f"n_compared={self.n_compared}, start_seed={self.start_seed}: at least 1 and 0.")

    def slack_m(self, reach_m: float) -> float:
        """How far a point of the probe can be from where it is at the exact pose, within the tolerances [m].

        Args:
            reach_m: How far the probe reaches from its tip, the lever with which a turn of the beam moves its end [m].
        """
        return self.position_tolerance_m + reach_m * self.angle_tolerance_rad

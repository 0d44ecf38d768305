"""What is wrong with the plan of where the organ lies, and how the true organ moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.errors import FieldError


@dataclass(frozen=True, kw_only=True)
class BodySettings:
    """How far the true world is from the planned one. Everything is 0, and so off, unless it is given."""

    registration_m: float = 0.0
    """How far the organ truly lies from where it was planned [m], in a direction drawn by the seed."""
    registration_rad: float = 0.0
    """By how much it is turned about its middle [rad], about an axis drawn by the seed."""
    tracking_m: float = 0.0
    """Standard deviation, along each axis, of where the tip is measured about where it is [m], anew at each contact."""
    tracking_rad: float = 0.0
    """Standard deviation, about each axis, of how the tip is measured to be turned [rad], likewise."""
    breathing_m: float = 0.0
    """How far the organ is moved at full inhale from where it rests at exhale [m]."""
    breathing_s: float = 4.0
    """Seconds of a breath."""
    breathing_axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Direction of that motion in the world; it need not be of unit length."""
    is_gated: bool = False
    """Whether the probe waits at each pose for the rest at exhale before it senses."""
    contact_search_m: float = 0.03
    """How far below the expected surface the probe goes on to look for contact [m]."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            FieldError: A value is out of range; it is named as people set it.
        """
        ranges = (
            ("registration_mm", self.registration_m * 1e3, 0.0, 100.0),
            ("registration_deg", np.rad2deg(self.registration_rad), 0.0, 45.0),
            ("tracking_mm", self.tracking_m * 1e3, 0.0, 50.0),
            ("tracking_deg", np.rad2deg(self.tracking_rad), 0.0, 45.0),
            ("breathing_mm", self.breathing_m * 1e3, 0.0, 100.0),
            ("breathing_s", self.breathing_s, 0.5, 60.0),
            ("contact_search_mm", self.contact_search_m * 1e3, 0.0, 200.0),
        )
        for name, value, low, high in ranges:
            if not low <= value <= high:
                raise FieldError(name, float(f"{value:.6g}"), f"must be from {low:g} to {high:g}.")
        if not np.linalg.norm(self.breathing_axis) > 0.0:
            raise FieldError("breathing_axis", self.breathing_axis, "must not be of zero length.")

    @property
    def is_as_planned(self) -> bool:
        """Whether the organ lies still, exactly where it was planned, and the tip is where it is measured."""
        sizes = (self.registration_m, self.registration_rad, self.tracking_m, self.tracking_rad)
        return not any((*sizes, self.breathing_m))

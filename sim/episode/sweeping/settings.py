"""Settings of a sweep: how fast the probe glides, how often it reads, and how far its beam may tilt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class SweepSettings:
    """How the probe glides over the organ, and how often it reads on the way."""

    speed_m_s: float = 0.04
    """Speed limit of the tip in contact [m/s]; somewhat below that of an approach."""
    read_every_m: float = 0.01
    """Way of the tip from one reading to the next [m]."""
    frame_rate_hz: float = 10.0
    """Readings that the sensor makes in a second at most."""
    most_tilt_rad: float = float(np.deg2rad(15.0))
    """The beam is never farther from the surface's normal than this [rad]."""

    def __post_init__(self) -> None:
        """Validate the ranges.

        Raises:
            ValueError: A value is out of range, or more readings are wanted than the sensor makes.
        """
        for name in ("speed_m_s", "read_every_m", "frame_rate_hz"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}={value}: must be a positive, finite number.")
        if not 0.0 < self.most_tilt_rad <= np.pi / 4:
            raise ValueError(f"most_tilt_rad={self.most_tilt_rad}: must be above 0 and at most pi / 4.")
        wanted_hz = self.speed_m_s / self.read_every_m
        # Numbers that people type in millimetres carry rounding of 1e-16.
        if wanted_hz > self.frame_rate_hz * (1.0 + 1e-9):
            raise ValueError(
                f"read_every_m={self.read_every_m}: at {self.speed_m_s:g} m/s that is {wanted_hz:.3g} readings a "
                f"second, and the sensor makes {self.frame_rate_hz:g}; read less often, glide more slowly, or name a "
                "faster sensor."
            )

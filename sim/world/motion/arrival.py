"""Arrival: whether the tip of a simulated arm is where it was sent, or so far from it that a reading means little.

The tip is sent to `press_m` below the surface and the organ pushes it back, so an arm that gives way may end anywhere
between the surface and that depth: how far it is off is its distance from the line between these two points. Where the
servos hold, this is some hundredths of a millimetre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.world.ik.chain import ChainState

TIP_TOLERANCE_M = 0.003
"""A tip farther than this from where it was sent is not there [m]. The embedded probe's face has a radius of 8 mm, so
it still lies over the pose."""
BEAM_TOLERANCE_RAD = np.deg2rad(2.0)
"""Nor is a beam turned by more than this [rad]: at the end of a cone of 100 mm that is 3.5 mm, about as much."""


@dataclass(frozen=True)
class Arrival:
    """Where a tip got to, beside where it was sent."""

    error_m: float
    """Distance of the tip from where it was sent [m]."""
    error_rad: float
    """Angle between the beam and where it was sent [rad]."""
    miss_m: float
    """Distance of the tip from the line between the surface and where it was sent [m]."""

    @classmethod
    def of(cls, there_and_sent: ChainState, *, press_m: float) -> Arrival:
        """How far a tip got.

        Args:
            there_and_sent: Where the tip is and where it was sent, two rows.
            press_m: How far below the surface it was sent [m].
        """
        away_m = there_and_sent.tips_m[0] - there_and_sent.tips_m[1]
        beam, sent = there_and_sent.beams
        cosine = float(np.clip(beam @ sent, -1.0, 1.0))
        sine = float(np.linalg.norm(np.cross(beam, sent)))
        back_m = float(np.clip(-away_m @ sent, 0.0, press_m))
        return cls(
            error_m=float(np.linalg.norm(away_m)),
            error_rad=float(np.arctan2(sine, cosine)),
            miss_m=float(np.linalg.norm(away_m + back_m * sent)),
        )

    @property
    def is_there(self) -> bool:
        """Whether tip and beam are within the tolerances; NaN is not."""
        return self.miss_m <= TIP_TOLERANCE_M and self.error_rad <= BEAM_TOLERANCE_RAD

    def reason(self) -> str:
        """A sentence that says why there is no reading."""
        return (
            f"The servos left the tip {self.miss_m * 1e3:.1f} mm and the beam {np.rad2deg(self.error_rad):.1f} "
            f"degrees from where they were sent; {TIP_TOLERANCE_M * 1e3:g} mm and "
            f"{np.rad2deg(BEAM_TOLERANCE_RAD):g} degrees are allowed. The arm's torques are too small, or something "
            "holds it back."
        )

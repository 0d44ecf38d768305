"""How an episode's true world differs from its plan, what is expected of that, and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mapping.registration import RigidPrior
from sim.world.body.settings import BodySettings
from sim.world.motion.settings import MotionSettings
from sim.world.tissue.settings import ElasticSettings

Registration = Literal["contacts", "none"]
"""What tells during an episode where the organ lies: the contacts of the probe, or nothing."""


@dataclass(frozen=True, kw_only=True)
class BodyOptions:
    """How the true world differs from the plan, and what is made of it."""

    settings: BodySettings
    registration: Registration = "contacts"
    """What tells where the organ lies."""
    aligns_readings: bool = True
    """Whether readings whose tips are measured with an error are moved to where their labels fit each other's."""
    tissue: ElasticSettings | None = None
    """What the organ is made of that yields under the probe; None where it is rigid."""
    press_n: float = 1.0
    """Force at which the probe stops on an organ that yields [N]."""
    motion: MotionSettings = field(default_factory=MotionSettings)
    """Speeds of the way down."""
    register_above_m: float = np.inf
    """How far the organ has to be believed off for an action to be spent on its place [m]."""
    prior: RigidPrior | None = None
    """What is expected of the place; None where it is known how far plans and breaths of this kind go."""

    @property
    def yields(self) -> bool:
        """Whether readings are taken back to an organ at rest by a model of its tissue: only where somebody asks."""
        return self.tissue is not None and self.registration != "none"

    def place_deviation_m(self, depth_m: float) -> float:
        """How far labels are believed to lie off along the surface, a standard deviation [m]: 0 where nobody asks.

        That is what is known of the tip's measured place, and of its turn at half of the depth that is sensed.

        Args:
            depth_m: How deep a view reaches [m].
        """
        if self.registration == "none":
            return 0.0
        return float(np.hypot(self.settings.tracking_m, 0.5 * depth_m * self.settings.tracking_rad))


@dataclass(frozen=True)
class BodyScore:
    """How well it is known after an action where the organ lies."""

    registration_error_m: float
    """Mean distance between where the tumours are believed to lie and where they lie, at exhale [m]; without tumours,
    that of the organ's middle."""
    registration_deviation_m: float
    """What the belief says of that distance: the root of its mean square [m]; 0 where nothing is believed."""
    registration_within_share: float | None
    """Share of the tumours that lie in the ellipsoid of 95 % that the belief states; None where it states none."""


LEAST_PRIOR_M, LEAST_PRIOR_RAD = 1e-4, 1e-4
"""What a plan that is said to be exact is still expected to be off, along and about each axis."""


def expected_place(settings: BodySettings) -> RigidPrior:
    """What is expected where it is known how far plans and breaths of this kind go: so far along each axis.

    That is wider by the root of 3 than a vector of known length in an unknown direction, so that a belief learnt from
    contacts outweighs it soon.
    """
    return RigidPrior(
        shift_m=max(settings.registration_m, LEAST_PRIOR_M),
        turn_rad=max(settings.registration_rad, LEAST_PRIOR_RAD),
        breath_m=settings.breathing_m,
    )

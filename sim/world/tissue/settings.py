"""What the tissue of an organ is made of, and how finely it is modelled."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim.world.errors import TissueError

MOST_PASCAL = 1e9
"""A modulus above this [Pa] is no tissue: bone has some 1e10 Pa and is not pressed in."""


@dataclass(frozen=True, kw_only=True)
class ElasticSettings:
    """Linear isotropic elasticity of the organ and of the tumours in it.

    Raises:
        TissueError: A value out of its range.
    """

    youngs_modulus_pa: float = 5000.0
    """Young's modulus of the organ [Pa]: healthy liver has 4.1-4.7 kPa (Fung 2013), normal liver up to 6.6 kPa."""

    poissons_ratio: float = 0.49
    """Poisson's ratio of organ and tumours: soft tissue keeps its volume nearly, which would be 0.5."""

    tumour_youngs_modulus_pa: float = 50_000.0
    """Young's modulus of the tumours [Pa]: elastography finds about 50 kPa in metastases and carcinomas."""

    rest_height_share: float = 0.2
    """The organ rests on, and sticks to, what faces down within this share of its height above its lowest point."""

    element_size_m: float | None = None
    """Edge of the lattice's cells [m]; None takes as many cells as make `MEAN_CELLS` times their volume the organ's."""

    def __post_init__(self) -> None:
        """Holds each value against its range."""
        for name in ("youngs_modulus_pa", "tumour_youngs_modulus_pa"):
            value = getattr(self, name)
            if not (math.isfinite(value) and 0.0 < value <= MOST_PASCAL):
                raise TissueError(
                    f"{name}={value} must be above 0 and at most {MOST_PASCAL:g} Pa: tissue without stiffness carries "
                    "no probe; liver has about 5000"
                )
        if not 0.0 <= self.poissons_ratio <= 0.499:
            raise TissueError(
                f"poissons_ratio={self.poissons_ratio} must lie in 0 to 0.499; soft tissue has 0.45 to 0.49"
            )
        if not 0.0 < self.rest_height_share <= 1.0:
            raise TissueError(
                f"rest_height_share={self.rest_height_share} must be above 0 and at most 1: an organ that rests on "
                "nothing is pushed away"
            )
        size_m = self.element_size_m
        if size_m is not None and not (math.isfinite(size_m) and size_m > 0.0):
            raise TissueError(
                f"element_size_m={size_m} must be above 0, or None for a size made for the organ"
            )

    @property
    def shear_modulus_pa(self) -> float:
        """G = E / (2 (1 + nu)) of the organ [Pa]."""
        return self.youngs_modulus_pa / (2.0 * (1.0 + self.poissons_ratio))

    @property
    def contact_modulus_pa(self) -> float:
        """E* = E / (1 - nu^2) of the organ [Pa], which the laws of contact with a rigid body have."""
        return self.youngs_modulus_pa / (1.0 - self.poissons_ratio**2)

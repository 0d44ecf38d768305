"""The sensed volume: a right circular cone below the probe's tip."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import PlannerError


@dataclass(frozen=True)
class Cone:
    """A right circular cone: apex at the tip, axis along the beam, flat base at its depth."""

    half_angle_rad: float
    """Angle between the axis and the mantle [rad], above 0 and below pi / 2."""
    depth_m: float
    """Distance from the apex to the base, along the axis [m], above 0."""

    def __post_init__(self) -> None:
        """Check both ranges."""
        if not 0.0 < self.half_angle_rad < math.pi / 2:
            raise PlannerError(
                f"half_angle_rad must lie between 0 and pi / 2 = {math.pi / 2:.4f} rad, got "
                f"{self.half_angle_rad} (is it in degrees? use math.radians)"
            )
        if not 0.0 < self.depth_m < math.inf:
            raise PlannerError(f"depth_m must be above 0 m and finite, got {self.depth_m}")

    @property
    def base_radius_m(self) -> float:
        """Radius of the cone's base [m]: tan(half angle) depth."""
        return math.tan(self.half_angle_rad) * self.depth_m

    @property
    def volume_m3(self) -> float:
        """Volume of the cone [m^3]: pi / 3 tan^2(half angle) depth^3."""
        return math.pi / 3.0 * math.tan(self.half_angle_rad) ** 2 * self.depth_m**3

    def contains(self, points_m: ArrayLike, apex_m: ArrayLike, axis: ArrayLike) -> NDArray[np.bool_]:
        """Whether each point lies in the cone, its surface and apex included, shape (N,).

        The arguments broadcast against one another, so that one point can be tested against the cones of many
        poses as well as many points against one cone.

        Args:
            points_m: Points [m], shape (N, 3) or (3,).
            apex_m: Apex of the cone [m], shape (3,) or (N, 3).
            axis: Unit vector of the axis, from the apex to the base, shape (3,) or (N, 3).
        """
        offsets = np.asarray(points_m, dtype=np.float64) - np.asarray(apex_m, dtype=np.float64)
        axis = np.asarray(axis, dtype=np.float64)
        axial = np.sum(offsets * axis, axis=-1)
        lateral_squared = np.sum((offsets - axial[..., None] * axis) ** 2, axis=-1)
        is_within_angle = lateral_squared <= (axial * math.tan(self.half_angle_rad)) ** 2
        return (axial >= 0.0) & (axial <= self.depth_m) & is_within_angle

"""The sensed volume: a right circular cone below the probe's tip (the paper's v_i, section IV-A).

The paper gives the cone neither angle nor depth; a scenario does.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import PlannerError


@dataclass(frozen=True)
class Cone:
    """A right circular cone: its apex at the probe's tip, its axis along the beam, its flat base at its depth.

    With p the apex, o the unit vector along the beam, a = (x - p) . o the distance of a point x along the axis and
    l = |x - p - a o| its distance from the axis, the cone of half-angle alpha and depth d is the set of points with

        0 <= a <= d   and   l <= a tan(alpha).
    """

    half_angle_rad: float
    """Angle alpha between the axis and the mantle [rad], above 0 and below pi / 2."""
    depth_m: float
    """Distance d from the apex to the base, along the axis [m], above 0."""

    def __post_init__(self) -> None:
        """Checks both ranges."""
        if not 0.0 < self.half_angle_rad < math.pi / 2:
            raise PlannerError(
                f"half_angle_rad must lie between 0 and pi / 2 = {math.pi / 2:.4f} rad, got "
                f"{self.half_angle_rad} (is it in degrees? use math.radians)"
            )
        if not 0.0 < self.depth_m < math.inf:
            raise PlannerError(f"depth_m must be above 0 m and finite, got {self.depth_m}")

    @property
    def base_radius_m(self) -> float:
        """The radius of the cone's base [m], d tan(alpha)."""
        return math.tan(self.half_angle_rad) * self.depth_m

    @property
    def volume_m3(self) -> float:
        """The volume of the cone [m^3], pi / 3 d^3 tan^2(alpha)."""
        return math.pi / 3.0 * math.tan(self.half_angle_rad) ** 2 * self.depth_m**3

    def contains(self, points_m: ArrayLike, apex_m: ArrayLike, axis: ArrayLike) -> NDArray[np.bool_]:
        """Whether each point lies in the cone, its surface and apex included, shape (N,).

        The test is the class's two inequalities, the second squared. The arguments broadcast against one another, so
        that one point can be tested against the cones of many poses as well as many points against one cone.

        Args:
            points_m: Points x [m], shape (N, 3) or (3,).
            apex_m: Apex p of the cone [m], shape (3,) or (N, 3).
            axis: Unit vector o of the axis, from the apex to the base, shape (3,) or (N, 3).
        """
        offsets = np.asarray(points_m, dtype=np.float64) - np.asarray(apex_m, dtype=np.float64)
        axis = np.asarray(axis, dtype=np.float64)
        axial = np.sum(offsets * axis, axis=-1)
        lateral_squared = np.sum((offsets - axial[..., None] * axis) ** 2, axis=-1)
        is_within_angle = lateral_squared <= (axial * math.tan(self.half_angle_rad)) ** 2
        return (axial >= 0.0) & (axial <= self.depth_m) & is_within_angle

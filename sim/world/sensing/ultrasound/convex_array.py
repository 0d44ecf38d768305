"""The convex array: its face, its lines, and where a sample of a line lies in a plane."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.errors import FieldError
from sim.world.memory import spare_bytes

SPEED_M_S = 1540.0
"""Speed of sound that the machine assumes, and here that of every tissue: nothing is displaced and nothing refracts."""

BYTES_PER_SAMPLE = 32
"""Memory that a sample of a plane takes while the plane is drawn."""


@dataclass(frozen=True, kw_only=True)
class ConvexArray:
    """A curved array whose middle touches the organ at the probe's tip.

    A plane has x across the lines, y through its thickness and z along the beam, with its origin at the tip. The face
    is an arc about the point z = -radius, from which all lines diverge. So the image begins on the width of the face.
    """

    face_width_m: float = 0.025
    """Width of the face, the chord of its arc [m]."""
    radius_m: float = 0.025
    """Radius of curvature of the face [m]."""
    depth_m: float = 0.13
    """Length of the lines [m]."""
    n_lines: int = 192
    """Lines of a plane."""
    n_samples: int = 1024
    """Samples on a line."""
    frequency_hz: float = 3.5e6
    """Centre frequency of the pulse [Hz]."""
    bandwidth: float = 0.6
    """Width of the pulse's spectrum at half its amplitude, as a share of the centre frequency."""
    focus_m: float = 0.065
    """Depth at which the transmitted beam is focused [m]."""
    aperture_m: float = 0.016
    """Width of the part of the face that makes one line [m]; no wider than the face."""
    f_number: float = 2.0
    """Depth over receiving aperture near the face, where the aperture grows with depth."""
    height_m: float = 0.008
    """Height of the face across the plane, which gives the slice its thickness [m]."""
    height_focus_m: float = 0.07
    """Depth of the focus of the lens across the plane [m]."""

    def __post_init__(self) -> None:
        """Checks that lengths are above 0, that the face is an arc, and that memory holds a plane."""
        for name in (
            "depth_m",
            "frequency_hz",
            "focus_m",
            "aperture_m",
            "f_number",
            "height_m",
            "height_focus_m",
        ):
            _check(name, getattr(self, name), 0.0 < getattr(self, name) < math.inf, "must be above 0.")
        _check("face_width_m", self.face_width_m, self.face_width_m > 0.0, "must be above 0.")
        remedy = "must be more than half of the width of the face, whose arc it is."
        _check("radius_m", self.radius_m, 0.52 * self.face_width_m <= self.radius_m < math.inf, remedy)
        _check("bandwidth", self.bandwidth, 0.1 <= self.bandwidth <= 1.5, "must be from 0.1 to 1.5.")
        _check("n_lines", self.n_lines, self.n_lines >= 8, "must be at least 8.")
        _check("n_samples", self.n_samples, self.n_samples >= 32, "must be at least 32.")
        needed = BYTES_PER_SAMPLE * float(self.n_lines) * float(self.n_samples)
        remedy = (
            f"a plane of {self.n_lines} lines takes {needed / 2**30:.1f} GiB, more than there is; name fewer."
        )
        _check("n_samples", self.n_samples, needed <= spare_bytes(), remedy)

    @property
    def wavelength_m(self) -> float:
        """Wavelength of the centre frequency [m]."""
        return SPEED_M_S / self.frequency_hz

    @property
    def open_m(self) -> float:
        """Width of the part of the face that makes one line, which is no wider than the face [m]."""
        return min(self.aperture_m, self.face_width_m)

    @property
    def half_angle_rad(self) -> float:
        """Angle of the outermost line to the beam's axis [rad]."""
        return math.asin(0.5 * self.face_width_m / self.radius_m)

    @property
    def sample_m(self) -> float:
        """Distance of samples along a line [m]; sample i lies at (i + 1/2) of it below the face."""
        return self.depth_m / self.n_samples

    @property
    def line_rad(self) -> float:
        """Angle between neighbouring lines [rad]."""
        return 2.0 * self.half_angle_rad / (self.n_lines - 1)

    @property
    def angles_rad(self) -> NDArray[np.float64]:
        """Angles of the lines to the axis, shape (n_lines,) [rad]."""
        return np.linspace(-self.half_angle_rad, self.half_angle_rad, self.n_lines)

    @property
    def depths_m(self) -> NDArray[np.float64]:
        """Depths of the samples below the face, shape (n_samples,) [m]."""
        return (np.arange(self.n_samples, dtype=np.float64) + 0.5) * self.sample_m

    def points_m(self, lines: ArrayLike, samples: ArrayLike) -> NDArray[np.float64]:
        """Where samples lie in the plane [m], shape (..., 3).

        Args:
            lines: Numbers of lines, not necessarily whole, any shape.
            samples: Numbers of samples on them, in the same shape.
        """
        angle_rad = np.asarray(lines, dtype=np.float64) * self.line_rad - self.half_angle_rad
        range_m = self.radius_m + (np.asarray(samples, dtype=np.float64) + 0.5) * self.sample_m
        x_m, z_m = range_m * np.sin(angle_rad), range_m * np.cos(angle_rad) - self.radius_m
        return np.stack([x_m, np.zeros_like(x_m), z_m], axis=-1)


def _check(name: str, value: float, is_right: bool, remedy: str) -> None:
    if not is_right:
        raise FieldError(name, value, remedy)

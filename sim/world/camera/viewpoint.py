"""Viewpoints: where a camera has to stand, and how wide its window has to be, for a picture to hold given points.

The window need not be centred on the line of sight, as with a camera whose lens can be shifted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEAST_SHARE, MOST_SHARE = 0.36, 0.6
"""Least and largest share of the picture's width that its subject takes; of the height it takes the latter at most."""
AIR = 0.05
"""Room at each edge, as a share of what has to be seen."""
SIZES_AWAY, LEAST_AWAY_M = 3.0, 0.35
"""Distance of the camera from the subject's middle, in sizes of the subject and at least [m]."""
TURN_RAD, ELEVATION_RAD = np.deg2rad(-42.0), np.deg2rad(-25.0)
"""Turn from the line that has the subject in front of the base, and direction of view above the horizon."""


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Shares of a picture that are to stay free, from 0 to 1."""

    above: float = 0.0
    """Share of the height."""
    below: float = 0.0
    """Share of the height."""
    right: float = 0.0
    """Share of the width."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Viewpoint:
    """A camera and the window through which it sees; lengths of the window are at a distance of 1 before the eye."""

    eye_m: NDArray[np.float64]
    """Where the camera is [m, world], shape (3,)."""
    R_world_camera: NDArray[np.float64]
    """Its axes as columns: right, up and forward, shape (3, 3)."""
    centre: tuple[float, float]
    """Middle of the window, right and up of the line of sight."""
    half_height: float
    """Half of the window's height."""
    aspect: float
    """The window's width over its height."""

    def in_window(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points are seen, from left to right and from bottom to top, -1 to 1, shape (N, 2)."""
        seen = _projected(points_m, self.eye_m, self.R_world_camera)
        return (seen - self.centre) / (self.half_height * np.array([self.aspect, 1.0]))


def viewpoint_of(
    subject_m: NDArray[np.float64],
    others_m: NDArray[np.float64],
    *,
    aspect: float,
    base_rad: float,
    margins: Margins,
    least_share: float = LEAST_SHARE,
) -> Viewpoint:
    """The viewpoint from which a subject is seen large, and the other points as far as that allows.

    The subject takes `least_share` of the picture's width or more, and where that lets the others into the free part of
    the picture, they are all in it.

    Args:
        subject_m: Points that span the subject [m, world], shape (N, 3).
        others_m: Points that are to be in the picture too [m, world], shape (M, 3).
        aspect: The picture's width over its height.
        base_rad: Direction from the subject to the arm's base, about the vertical from +x.
        margins: What is to stay free.
        least_share: Least share of the width that the subject takes; 0 to have all points in the picture.
    """
    axes = _axes(base_rad + TURN_RAD, ELEVATION_RAD)
    middle_m = (subject_m.min(axis=0) + subject_m.max(axis=0)) / 2.0
    points_m = np.concatenate([subject_m, others_m])
    size_m = float(np.linalg.norm(np.ptp(subject_m if least_share else points_m, axis=0)))
    away_m = max(SIZES_AWAY * size_m, LEAST_AWAY_M)
    eye_m = middle_m - away_m * axes[:, 2]
    free = np.array([1.0 - margins.right, 1.0 - margins.above - margins.below])
    subject = _projected(subject_m, eye_m, axes)
    seen = np.concatenate([subject, _projected(others_m, eye_m, axes)])
    low, high = _padded(seen)
    own_low, own_high = _padded(subject)
    own = own_high - own_low
    height = max(((high - low) / free / (aspect, 1.0)).max(), (own / free / (aspect, 1.0)).max() / MOST_SHARE)
    if least_share:
        widest = np.ptp(subject, axis=0)[0] / least_share / aspect
        height = max(min(height, widest), (own / free / (aspect, 1.0)).max())
    window = height * np.array([aspect, 1.0])
    # The middle of what is shown comes to the middle of the free part; a subject is never pushed out of it.
    room = np.maximum((window * free - own) / 2.0, 0.0)
    own_middle = (own_low + own_high) / 2.0
    middle = np.clip((low + high) / 2.0, own_middle - room, own_middle + room)
    shift = np.array([margins.right, margins.above - margins.below]) / 2.0
    centre = middle + window * shift
    return Viewpoint(
        eye_m=eye_m,
        R_world_camera=axes,
        centre=(float(centre[0]), float(centre[1])),
        half_height=float(height) / 2.0,
        aspect=aspect,
    )


def _padded(seen: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low, high = seen.min(axis=0), seen.max(axis=0)
    pad = AIR * (high - low)
    return low - pad, high + pad


def _axes(azimuth_rad: float, elevation_rad: float) -> NDArray[np.float64]:
    """A camera's axes as columns: right, up and forward, shape (3, 3)."""
    cos, sin = np.cos(azimuth_rad), np.sin(azimuth_rad)
    forward = np.array([np.cos(elevation_rad) * cos, np.cos(elevation_rad) * sin, np.sin(elevation_rad)])
    right = np.array([sin, -cos, 0.0])
    return np.column_stack([right, np.cross(right, forward), forward])


def _projected(
    points_m: NDArray[np.float64], eye_m: NDArray[np.float64], axes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where points are seen at a distance of 1 before the eye, shape (N, 2); what is behind it lies far outside."""
    across, up, ahead = ((points_m - eye_m) @ axes).T
    ahead = np.maximum(ahead, 1e-2)
    return np.column_stack([across / ahead, up / ahead])

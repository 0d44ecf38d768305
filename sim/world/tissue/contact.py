"""Where a probe's face stands on an organ, and the pieces of the surface that its force is spread over."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.world.errors import TissueError

from .outer_surface import OuterSurface

Array = NDArray[np.float64]

SPREAD_CELLS, SPREAD_FACES = 1.25, 1.25
"""The coarse model's force is spread over a disc of so many cells' edges, or radii of the face where that is more."""
OFF_SURFACE_M = 0.005
"""A face farther from the surface than this does not touch it [m]."""
LEAST_COSINE = 0.3
"""A face whose axis is turned further off the surface's normal, some 73 degrees, slides off."""
MOST_FORCE_N = 100.0
"""No scan presses harder: abdominal scanning reaches 34.5 N."""
MOST_STRAIN = 2.0
"""Above a strain of 1 linear tissue passes through itself below the face; above this the field has no meaning left."""


@dataclass(frozen=True, eq=False)
class Contact:
    """A flat round face on the surface.

    Attributes:
        position_m: Its middle on the undeformed surface [m], shape (3,).
        direction: Unit vector into the organ, shape (3,).
        face_radius_m: Its radius [m].
        spread_radius_m: Radius of the disc that the coarse model's force is spread over [m].
    """

    position_m: Array
    direction: Array
    face_radius_m: float
    spread_radius_m: float

    def force_of(
        self, compliance_m_per_n: float, *, force_n: float | None, depth_m: float | None, thickness_m: float
    ) -> float:
        """The force of an indentation [N], given by itself or by its depth.

        Raises:
            TissueError: Not one of both, a value out of range, or a depth of `thickness_m` or more.
        """
        if (force_n is None) == (depth_m is None):
            raise TissueError(
                f"force_n={force_n} and depth_m={depth_m}: give one of them, which makes the other"
            )
        if depth_m is None:
            depth_m = compliance_m_per_n * _in_range("force_n", force_n, MOST_FORCE_N, "N")
        if _in_range("depth_m", depth_m, np.inf, "m") >= thickness_m:
            raise TissueError(
                f"the face would go {1e3 * depth_m:.3g} mm into an organ {1e3 * thickness_m:.3g} mm thick: press less, "
                "or make the tissue stiffer"
            )
        return depth_m / compliance_m_per_n

    def check_strain(self, force_n: float, contact_modulus_pa: float) -> float:
        """The strain on the face's axis at its largest: d / (pi a) of a flat punch, at a depth of one radius.

        Raises:
            TissueError: It is above `MOST_STRAIN`.
        """
        strain = force_n / (2.0 * np.pi * contact_modulus_pa * self.face_radius_m**2)
        if strain > MOST_STRAIN:
            raise TissueError(
                f"force_n={force_n:.3g} on a face of {1e3 * self.face_radius_m:.3g} mm radius strains the tissue by "
                f"{strain:.2g}, and linear elasticity means nothing above {MOST_STRAIN:g}: press with at most "
                f"{force_n * MOST_STRAIN / strain:.3g} N, with a wider face, or make the tissue stiffer"
            )
        return strain


def checked_contact(
    surface: OuterSurface,
    position_m: ArrayLike,
    direction: ArrayLike,
    face_radius_m: float,
    *,
    cell_size_m: float,
) -> Contact:
    """The contact of a face with a surface.

    Raises:
        TissueError: A position that is not on the surface, no direction, or a radius out of range.
    """
    position, axis = np.asarray(position_m, dtype=np.float64), np.asarray(direction, dtype=np.float64)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise TissueError(f"position_m={position_m} must be three finite numbers [m]")
    if axis.shape != (3,) or not np.isfinite(axis).all() or not np.linalg.norm(axis) > 0.0:
        raise TissueError(f"direction={direction} must be three finite numbers, not all 0")
    span_m = float(surface.spans_m.max())
    _in_range("face_radius_m", face_radius_m, 0.5 * span_m, "m, half the organ's length")
    on_surface_m = surface.closest_to(position)
    off_m = float(np.linalg.norm(on_surface_m - position))
    if off_m > OFF_SURFACE_M:
        raise TissueError(
            f"position_m={np.round(position, 4).tolist()} is {1e3 * off_m:.3g} mm off the organ's surface: a face "
            f"touches within {1e3 * OFF_SURFACE_M:g} mm"
        )
    spread_m = max(SPREAD_CELLS * cell_size_m, SPREAD_FACES * face_radius_m)
    return Contact(on_surface_m, axis / np.linalg.norm(axis), float(face_radius_m), spread_m)


def spread_weights(surface: OuterSurface, contact: Contact) -> tuple[NDArray[np.int64], Array]:
    """The pieces of the surface that a force is spread over, and the share of the force on each, shape (K,) both.

    The shares follow Hertz's pressure over the disc, seen along the probe's axis. They add up to 1, and where the disc
    hangs over a rim they are tilted so that their mean place is still the middle of the face.

    Raises:
        TissueError: The surface does not face the probe.
    """
    # The disc may lie as high as it is wide above or below the face's middle.
    near = surface.around(contact.position_m, np.sqrt(2.0) * contact.spread_radius_m)
    offset_m = surface.points_m[near] - contact.position_m
    height_m = offset_m @ contact.direction
    beside_m = offset_m - height_m[:, None] * contact.direction
    radial = np.linalg.norm(beside_m, axis=1) / contact.spread_radius_m
    facing = -surface.normals[near] @ contact.direction
    is_loaded = (radial < 1.0) & (np.abs(height_m) < contact.spread_radius_m) & (facing > 0.0)
    near, radial, facing, beside_m = (
        near[is_loaded],
        radial[is_loaded],
        facing[is_loaded],
        beside_m[is_loaded],
    )
    by_area = np.sqrt(1.0 - radial**2) * surface.areas_m2[near]
    weights, area_m2 = by_area * facing, float(surface.areas_m2[near].sum())
    if not weights.sum() > LEAST_COSINE * by_area.sum():
        raise TissueError(
            f"direction={np.round(contact.direction, 3).tolist()} does not point into the organ at "
            f"{np.round(contact.position_m, 4).tolist()}, where {1e4 * area_m2:.3g} cm^2 face the probe: press along "
            "the inward normal"
        )
    weights /= weights.sum()
    spread = (beside_m * weights[:, None]).T @ beside_m
    tilt = np.linalg.pinv(spread, rcond=1e-6) @ (weights @ beside_m)
    weights *= np.maximum(1.0 - beside_m @ tilt, 0.0)
    return near, weights / weights.sum()


def _in_range(name: str, value: float | None, most: float, unit: str) -> float:
    if value is None or not (math.isfinite(value) and 0.0 < value <= most):
        raise TissueError(f"{name}={value} must be above 0 and at most {most:.3g} {unit}")
    return float(value)

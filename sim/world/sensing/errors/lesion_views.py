"""A lesion in a view: whether the reader misses it, and where the reader draws its outline."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance

from .echogenicity import Echogenicity, echogenicity_of, lesion_rng_seed
from .reader_errors import ReaderErrors
from .smooth_field import SmoothField

REFERENCE_DIAMETER_M = 0.010
"""Lesions of this diameter are missed with the chance that an option states [m]."""
_REACH = 4.0
"""The outline strays no farther than this many standard deviations."""


class Lesion:
    """A lesion with all that belongs to it and not to a view."""

    def __init__(self, solid: Solid) -> None:
        """Takes the lesion's surface."""
        self.solid = solid
        self.looks: Echogenicity = echogenicity_of(solid)
        self.diameter_m = (6.0 * abs(solid.volume_m3) / np.pi) ** (1.0 / 3.0)
        self._distance = SurfaceDistance(solid)

    def shared_field(self, length_m: float) -> SmoothField:
        """What all views of the lesion's outline have in common."""
        return SmoothField.drawn(length_m, np.random.default_rng((lesion_rng_seed(self.solid), 1)))

    def signed_distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of points [m], shape (N, 3), to the lesion's surface [m], negative inside, shape (N,)."""
        return self._distance.signed_distance_m(points_m)

    def around(self, points_m: NDArray[np.float64], margin_m: float) -> NDArray[np.intp]:
        """Indices of the points [m], shape (N, 3), in the lesion's box with a margin."""
        low_m, high_m = self.solid.bounds_m
        is_in = ((points_m >= low_m - margin_m) & (points_m <= high_m + margin_m)).all(axis=1)
        return np.flatnonzero(is_in)

    def outline_deviation_m(self, errors: ReaderErrors) -> float:
        """Standard deviation of the outline that a reader draws about the true one [m]."""
        radius_m = self.diameter_m / 2.0
        deviation_m = float(np.hypot(errors.boundary_m, errors.boundary_share * radius_m))
        return deviation_m * (self.looks.outline_factor if errors.boundary_by_echogenicity else 1.0)

    def chance_of_miss(self, errors: ReaderErrors, depth_m: float) -> float:
        """The chance that a view misses the lesion.

            missed_share (10 mm / diameter)^missed_size_power exp(missed_per_m depth), times a factor of how it looks

        Args:
            errors: What the reader gets wrong.
            depth_m: Depth of the lesion's nearest point in the view, along the beam [m].
        """
        chance = errors.missed_share * (REFERENCE_DIAMETER_M / self.diameter_m) ** errors.missed_size_power
        chance *= float(np.exp(errors.missed_per_m * depth_m))
        return min(chance * (self.looks.missed_factor if errors.missed_by_echogenicity else 1.0), 1.0)


@lru_cache(maxsize=256)
def lesion_of(solid: Solid) -> Lesion:
    """The lesion of a surface, kept for all its views."""
    return Lesion(solid)


def outlined(
    lesion: Lesion,
    points_m: NDArray[np.float64],
    depths_m: NDArray[np.float64],
    errors: ReaderErrors,
    rng: np.random.Generator,
) -> NDArray[np.bool_]:
    """Which points a reader puts into a lesion, shape (N,): none where the view misses it.

    A point at the signed distance d from the surface is put in where d < s (sqrt(c) g_lesion + sqrt(1 - c) g_view),
    with the outline's deviation s, its shared part c, and two smooth fields g: one of the lesion and one of the view.
    `rng` is drawn from in the same way whatever the points are.

    Args:
        lesion: The lesion.
        points_m: Points of the view, world frame [m], shape (N, 3).
        depths_m: Their depths along the beam [m], shape (N,).
        errors: What the reader gets wrong.
        rng: Source of the draws.
    """
    length_m = errors.boundary_length_m
    own, chance = SmoothField.drawn(length_m, rng), rng.random()
    is_in = np.zeros(len(points_m), dtype=bool)
    deviation_m = lesion.outline_deviation_m(errors)
    near = lesion.around(points_m, _REACH * deviation_m)
    if not near.size:
        return is_in
    if deviation_m > 0.0:
        shared, c = lesion.shared_field(length_m), errors.boundary_shared
        stray = np.sqrt(c) * shared.at(points_m[near]) + np.sqrt(1.0 - c) * own.at(points_m[near])
        is_in[near] = lesion.signed_distance_m(points_m[near]) < deviation_m * stray
    else:
        is_in[near] = lesion.solid.contains(points_m[near])
    if is_in.any() and chance < lesion.chance_of_miss(errors, float(depths_m[is_in].min())):
        is_in[:] = False
    return is_in

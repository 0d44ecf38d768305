"""Planting tumours by seed: spheres as in the paper's scenarios, lobulated shapes for livers.

Both check every tumour before it is accepted: inside the organ, apart from the others and, if the caller says
how to tell, within what the probe can ever sense.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import PlantingError
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance, surface_distance_of

from .tumour_shapes import ball_shape, lobulated_shape

Attainable = Callable[[NDArray[np.float64]], float]
"""Given points [m], shape (N, 3), the fraction of them that some pose of the probe can sense."""

IsDeep = Callable[[NDArray[np.float64]], bool]
"""Given a tumour's vertices [m], shape (V, 3), whether all of them are deep enough in the organ."""

LEAST_ATTAINABLE = 0.95
"""A planted tumour is accepted if at least this share of it can be sensed from somewhere."""

N_ATTAINABLE_POINTS = 500
"""Points drawn in a tumour to judge how much of it is attainable."""

SPHERE_DEPTH_RANGE_M = (0.036, 0.084)
"""Depth of a sphere's centre below the surface above it [m]: the paper scenario's 1.2 to 2.8 units."""

SPHERE_HALF_WIDTH_M = 0.066
"""Largest |x| and |y| of a sphere's centre from the organ's middle [m]: the paper scenario's 2.2 units."""

SPHERE_RADIUS_M = 0.012
"""The paper scenario's radius of 0.4 units [m]."""

LOBULATED_DIAMETER_RANGE_M = (0.008, 0.040)
"""Equivalent diameters of planted liver tumours [m]."""

MEDIAN_DIAMETER_M = 0.016
"""Median of the lognormal that diameters are drawn from [m]: 58 % of liver metastases are under 20 mm."""

DIAMETER_LOG_SPREAD = 0.6
"""Standard deviation of the logarithm of the diameter, from the LiTS statistics."""

LEAST_DEPTH_M = 0.0025
"""Least tissue between a planted lobulated tumour and the capsule [m]."""

LEAST_GAP_M = 0.002
"""Least distance between planted tumours [m]."""

LOAD_SHRINKING = 5.0 / 6.0
"""Factor by which a tumour of a load is made smaller until it fits."""

LEAST_LOAD_DIAMETER_M = 0.004
"""A tumour of a load that would have to be smaller [m] is left out."""

N_PLACES = 200
"""Places tried for one tumour before its next size, or an error."""

N_SIZES = 10
"""Sizes drawn for one lobulated tumour before an error."""


def plant_spheres(
    organ: Solid,
    n: int,
    *,
    rng: np.random.Generator,
    radius_m: float = SPHERE_RADIUS_M,
    depth_range_m: tuple[float, float] = SPHERE_DEPTH_RANGE_M,
    half_width_m: float = SPHERE_HALF_WIDTH_M,
    is_attainable: Attainable | None = None,
) -> tuple[Solid, ...]:
    """Spheres below the organ's upper surface, even in x, y and depth, inside the organ and apart.

    The paper's organ is not deep enough for its deepest spheres under its deepest dip; such places are drawn
    again.

    Args:
        organ: The organ, in a frame with z up.
        n: Number of spheres.
        rng: Source of the draws.
        radius_m: Radius [m]; the mesh has the volume of this sphere.
        depth_range_m: Depth of the centre below the surface straight above it [m].
        half_width_m: Largest |x| and |y| of the centre from the middle of the organ's bounding box [m].
        is_attainable: Given points in the tumour, the fraction that can be sensed, which must be at least 95 %.

    Returns:
        The spheres.

    Raises:
        ValueError: An argument out of range.
        PlantingError: No place was found for a sphere.
    """
    _check_count(n)
    if not radius_m > 0.0 or not 0.0 <= depth_range_m[0] <= depth_range_m[1] or not half_width_m >= 0.0:
        raise ValueError(
            f"radius_m={radius_m} must be above 0, depth_range_m={depth_range_m} ascending from 0 on, "
            f"half_width_m={half_width_m} at least 0"
        )
    unit_m, faces = ball_shape()
    shape_m = unit_m * radius_m

    def is_deep(points_m: NDArray[np.float64]) -> bool:
        return bool(organ.contains(points_m).all())

    planting = _Planting(is_deep, is_attainable, rng)
    for index in range(n):
        centres_m = _centres_below_surface(organ, depth_range_m, half_width_m, rng)
        if not any(planting.try_place(centre_m, shape_m, faces) for centre_m in centres_m):
            raise PlantingError(
                f"no place was found for sphere {index + 1} of {n} with radius {radius_m * 1e3:.3g} mm in "
                f"{N_PLACES} tries; ask for fewer or smaller spheres, or shallower ones"
            )
    return tuple(planting.planted)


def plant_lobulated(
    organ: Solid,
    n: int,
    *,
    rng: np.random.Generator,
    diameter_range_m: tuple[float, float] = LOBULATED_DIAMETER_RANGE_M,
    least_depth_m: float = LEAST_DEPTH_M,
    is_attainable: Attainable | None = None,
) -> tuple[Solid, ...]:
    """Lobulated tumours anywhere in the organ, below its capsule and apart.

    Diameters are lognormal about 16 mm, as in LiTS, within the range. The largest is placed first; one that
    fits nowhere is drawn again.

    Args:
        organ: The organ.
        n: Number of tumours.
        rng: Source of the draws.
        diameter_range_m: Smallest and largest diameter [m] of the sphere of equal volume.
        least_depth_m: Least distance between tumour and organ surface [m].
        is_attainable: Given points in the tumour, the fraction that can be sensed, which must be at least 95 %.

    Returns:
        The tumours, largest first but for those drawn again.

    Raises:
        ValueError: An argument out of range.
        PlantingError: No place was found for a tumour.
    """
    _check_count(n)
    if not 0.0 < diameter_range_m[0] <= diameter_range_m[1] or not least_depth_m >= 0.0:
        raise ValueError(
            f"diameter_range_m={diameter_range_m} must ascend from above 0 and least_depth_m={least_depth_m} "
            "be at least 0"
        )
    surface = surface_distance_of(organ)
    planting = _Planting(_deeper_than(least_depth_m, surface), is_attainable, rng)
    for diameter_m in sorted(_draw_diameters(n, diameter_range_m, rng), reverse=True):
        for _ in range(N_SIZES):
            if _place_lobulated(organ, surface, planting, diameter_m, least_depth_m):
                break
            diameter_m = _draw_diameters(1, diameter_range_m, rng)[0]
        else:
            raise PlantingError(
                f"no place was found for tumour {len(planting.planted) + 1} of {n} with diameters of "
                f"{diameter_range_m[0] * 1e3:.3g}-{diameter_range_m[1] * 1e3:.3g} mm; "
                "ask for fewer or smaller tumours"
            )
    return tuple(planting.planted)


def plant_load(
    organ: Solid,
    diameters_m: Sequence[float],
    *,
    rng: np.random.Generator,
    least_depth_m: float = LEAST_DEPTH_M,
    is_attainable: Attainable | None = None,
) -> tuple[Solid, ...]:
    """Lobulated tumours of given diameters, below the capsule and apart, the largest first.

    One that fits nowhere, or where the probe cannot sense 95 % of it, is made smaller by a sixth until it fits: a
    ball of a decimetre fits no liver with 2.5 mm of tissue all around. One that would shrink below 4 mm is left out.

    Args:
        organ: The organ.
        diameters_m: Diameters [m] of the spheres of equal volume.
        rng: Source of the draws.
        least_depth_m: Least distance between tumour and organ surface [m].
        is_attainable: Given points in the tumour, the fraction that can be sensed.

    Returns:
        The tumours.
    """
    surface = surface_distance_of(organ)
    planting = _Planting(_deeper_than(least_depth_m, surface), is_attainable, rng)
    for wanted_m in sorted(diameters_m, reverse=True):
        diameter_m = wanted_m
        while diameter_m >= LEAST_LOAD_DIAMETER_M:
            if _place_lobulated(organ, surface, planting, diameter_m, least_depth_m):
                break
            diameter_m *= LOAD_SHRINKING
    return tuple(planting.planted)


@dataclass
class _Planting:
    """The tumours planted so far, and what the next one must fulfil."""

    is_deep: IsDeep
    is_attainable: Attainable | None
    rng: np.random.Generator
    planted: list[Solid] = field(default_factory=list)

    def try_place(
        self, centre_m: NDArray[np.float64], shape_m: NDArray[np.float64], faces: NDArray[np.int64]
    ) -> bool:
        """True if the shape was planted at the place: apart from the others, deep enough, and attainable."""
        # The centre is a cheap first look.
        if self.is_attainable is not None and self.is_attainable(centre_m[None]) < LEAST_ATTAINABLE:
            return False
        tumour = Solid(shape_m + centre_m, faces)
        if any(_may_touch(tumour, other) for other in self.planted) or not self.is_deep(tumour.vertices_m):
            return False
        if self.is_attainable is not None:
            points_m = tumour.sample_inside(N_ATTAINABLE_POINTS, self.rng)
            if self.is_attainable(points_m) < LEAST_ATTAINABLE:
                return False
        self.planted.append(tumour)
        return True


def _deeper_than(least_depth_m: float, surface: SurfaceDistance) -> IsDeep:
    """Whether vertices lie at least so deep below a surface, as a function of them."""
    return lambda points_m: bool(surface.signed_distance_m(points_m).max() <= -least_depth_m)


def _place_lobulated(
    organ: Solid, surface: SurfaceDistance, planting: _Planting, diameter_m: float, least_depth_m: float
) -> bool:
    """True if a tumour of the diameter was planted at one of many places tried."""
    shape_m, faces = lobulated_shape(diameter_m, planting.rng)
    least_radius_m = float(np.linalg.norm(shape_m, axis=1).min())
    centres_m = organ.sample_inside(N_PLACES, planting.rng)
    deep_m = centres_m[surface.distance_m(centres_m) > least_depth_m + least_radius_m]
    return any(planting.try_place(centre_m, shape_m, faces) for centre_m in deep_m)


def _centres_below_surface(
    organ: Solid, depth_range_m: tuple[float, float], half_width_m: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float64]]:
    """Random centres below the upper surface, at most as many as there are tries."""
    middle_m = organ.bounds_m.mean(axis=0)[:2]
    for _ in range(N_PLACES):
        place_m = middle_m + rng.uniform(-half_width_m, half_width_m, 2)
        depth_m = rng.uniform(*depth_range_m)
        top_m = organ.top_height_m(place_m[None])[0]
        if np.isfinite(top_m):
            yield np.array([*place_m, top_m - depth_m])


def _may_touch(one: Solid, other: Solid) -> bool:
    """True if the balls around two tumours come closer than the least gap."""
    centres_m = [solid.vertices_m.mean(axis=0) for solid in (one, other)]
    radii_m = [
        np.linalg.norm(solid.vertices_m - centre, axis=1).max()
        for solid, centre in zip((one, other), centres_m, strict=True)
    ]
    return bool(np.linalg.norm(centres_m[0] - centres_m[1]) < sum(radii_m) + LEAST_GAP_M)


def _draw_diameters(n: int, range_m: tuple[float, float], rng: np.random.Generator) -> list[float]:
    """Diameters [m] from the lognormal, those out of range drawn again and at last put to the nearer end."""
    diameters = np.full(n, np.nan)
    for _ in range(100):
        is_open = ~((diameters >= range_m[0]) & (diameters <= range_m[1]))
        diameters[is_open] = rng.lognormal(np.log(MEDIAN_DIAMETER_M), DIAMETER_LOG_SPREAD, int(is_open.sum()))
    return np.clip(diameters, *range_m).tolist()


def _check_count(n: int) -> None:
    if n < 0:
        raise ValueError(f"n={n} must be at least 0")

"""An organ with its tumours: the truth of an episode.

Truth is what lies inside the organ and inside a tumour. Segmented tumours may protrude by some millimetres;
what protrudes is never sensed and counts as nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_closing, binary_dilation

from sim.world.errors import AnatomyError, MeshError
from sim.world.solids.solid import Solid, check_points
from sim.world.solids.surface_distance import SurfaceDistance
from sim.world.volumes.label_surface import ORGAN_SURFACE, surface_of
from sim.world.volumes.masks import filled

from .structures import Structure

N_DETECTION_POINTS = 500
"""Points per tumour whose share within the cones is the paper's measure of detection."""

LEAST_INSIDE_SHARE = 0.5
"""A tumour with a smaller share of its volume inside the organ belongs elsewhere."""

REMARKABLE_OUTSIDE_SHARE = 0.01
"""Share of a tumour outside the organ that is worth a notice."""

TOUCH_M = 3e-3
"""Surfaces touch where they are this close [m]: outlines of two masks that share a face are a voxel apart at most."""

LEAST_TOUCHING_SHARE = 0.05
"""A body touches the organ if this share of its vertices does."""

MAX_DRAWS = 50
"""Rounds of drawing points of a tumour that are also inside the organ."""


@dataclass(frozen=True, eq=False)
class Anatomy:
    """Organ and tumours in one frame, with the points by which detection is measured.

    Use `build_anatomy`, which draws the points and checks that the tumours fit.

    Attributes:
        organ: The organ.
        tumours: The tumours, possibly none.
        name: What to call it in outputs.
        notices: What a user should know of it, one sentence each.
        detection_points_m: Points drawn evenly inside each tumour and the organ [m], shape (D, 3).
        detection_tumours: Index of the tumour each of these lies in, shape (D,).
        structures: Vessels and the like, in the same frame.
        target: A second class to be mapped, as an anatomy of its own: the same organ, with the class's bodies in the
            tumours' place and the class's name. None where there is none.
    """

    organ: Solid
    tumours: tuple[Solid, ...]
    name: str
    notices: tuple[str, ...]
    detection_points_m: NDArray[np.float64]
    detection_tumours: NDArray[np.int64]
    structures: tuple[Structure, ...] = ()
    target: Anatomy | None = None

    def is_inside_organ(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """True for each point inside the organ. Points [m], shape (N, 3); result shape (N,)."""
        return self.organ.contains(points_m)

    def is_tumour(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """True for each point inside the organ and a tumour. Points [m], shape (N, 3); result shape (N,)."""
        return self.tumour_of(points_m) >= 0

    def tumour_of(self, points_m: ArrayLike) -> NDArray[np.int64]:
        """Index of the first tumour that holds each point, or -1.

        Args:
            points_m: Query points [m], shape (N, 3).

        Returns:
            Shape (N,); -1 for points outside the organ too.
        """
        points = check_points(points_m)
        tumour_of = np.full(len(points), -1, dtype=np.int64)
        for index in reversed(range(len(self.tumours))):
            tumour_of[self.tumours[index].contains(points)] = index
        held = np.flatnonzero(tumour_of >= 0)
        tumour_of[held[~self.organ.contains(points[held])]] = -1
        return tumour_of

    @property
    def tumour_middles_m(self) -> NDArray[np.float64]:
        """Where the middle of each tumour lies [m], shape (T, 3)."""
        return np.array([tumour.centroid_m for tumour in self.tumours]).reshape(-1, 3)

    @property
    def tumour_volumes_m3(self) -> NDArray[np.float64]:
        """Volume of each tumour's mesh [m^3], shape (number of tumours,)."""
        return np.array([tumour.volume_m3 for tumour in self.tumours], dtype=np.float64)


def build_anatomy(
    organ: Solid,
    tumours: tuple[Solid, ...] = (),
    *,
    name: str,
    rng: np.random.Generator,
    notices: tuple[str, ...] = (),
    tumour_names: tuple[str, ...] | None = None,
    n_detection_points: int = N_DETECTION_POINTS,
    structures: tuple[Structure, ...] = (),
    target: Anatomy | None = None,
) -> Anatomy:
    """An anatomy whose tumours have been checked to lie in the organ.

    Args:
        organ: The organ.
        tumours: The tumours in the same frame; none is allowed.
        name: What to call it in outputs.
        rng: Source of the detection points.
        notices: What a user should know of it already, for instance from the loader.
        tumour_names: What to call each tumour in messages; "tumour 1", "tumour 2", ... by default.
        n_detection_points: Detection points per tumour.
        structures: What lies in or about the organ, in the same frame.
        target: The second class, if there is one; its notices become those of the whole.

    Returns:
        The anatomy.

    Raises:
        AnatomyError: A tumour lies mostly outside the organ.
    """
    names = tumour_names or tuple(f"tumour {i + 1}" for i in range(len(tumours)))
    if len(names) != len(tumours):
        raise AnatomyError(f"{len(names)} tumour names were given for {len(tumours)} tumours")
    remarks, points = list(notices), [np.empty((0, 3))]
    for tumour, tumour_name in zip(tumours, names, strict=True):
        inside_m, outside_share = _draw_inside(organ, tumour, tumour_name, n_detection_points, rng)
        points.append(inside_m)
        if outside_share > REMARKABLE_OUTSIDE_SHARE:
            remarks.append(
                f"{tumour_name}: {outside_share:.0%} of it protrudes from the organ and is left out"
            )
    remarks += target.notices if target is not None else ()
    points_m = np.concatenate(points)
    tumour_index = np.repeat(np.arange(len(tumours)), n_detection_points)
    points_m.setflags(write=False)
    tumour_index.setflags(write=False)
    return Anatomy(
        organ, tuple(tumours), name, tuple(remarks), points_m, tumour_index, tuple(structures), target
    )


def joined_with_organ(
    organ: Solid, bodies: Sequence[tuple[str, Solid]], noun: str = "tumour"
) -> tuple[Solid, list[str]]:
    """The organ together with bodies that its outline leaves out, and a sentence on each.

    Some masks of an organ leave its tumours out. A body that lies mostly outside the organ, touches it along some of
    its surface and is smaller is taken for such a tumour: both are drawn on a lattice, the gap between them is closed,
    and one surface is drawn about them.

    Args:
        organ: The organ.
        bodies: The bodies with their names, in the same frame.
        noun: What they are.
    """
    left_out = [(name, body) for name, body in bodies if is_left_out(organ, body)]
    if not left_out:
        return organ, []
    said = [
        f"{name}: the organ's outline leaves this {noun} out and touches it; it was joined to the organ"
        for name, _ in left_out
    ]
    return _drawn_together(organ, [body for _, body in left_out]), said


def is_left_out(organ: Solid, body: Solid) -> bool:
    """Whether a body lies mostly outside an organ, touches it and is smaller."""
    if body.volume_m3 >= organ.volume_m3:
        return False
    try:
        inside = organ.contains(body.sample_inside(N_DETECTION_POINTS, np.random.default_rng(0)))
    except MeshError:
        return False
    if inside.mean() >= LEAST_INSIDE_SHARE:
        return False
    low_m, high_m = organ.bounds_m
    if (body.bounds_m[0] > high_m + TOUCH_M).any() or (body.bounds_m[1] < low_m - TOUCH_M).any():
        return False
    distance_m = SurfaceDistance(organ).distance_m(body.vertices_m)
    return bool((distance_m <= TOUCH_M).mean() >= LEAST_TOUCHING_SHARE)


def _drawn_together(organ: Solid, bodies: Sequence[Solid]) -> Solid:
    """One surface about an organ and bodies that touch it."""
    every = (organ, *bodies)
    low_m = np.min([each.bounds_m[0] for each in every], axis=0) - 2.0 * TOUCH_M
    high_m = np.max([each.bounds_m[1] for each in every], axis=0) + 2.0 * TOUCH_M
    spacing_m = ORGAN_SURFACE.spacing_m
    axes_m = [np.arange(low, high, spacing_m) for low, high in zip(low_m, high_m, strict=True)]
    points_m = np.stack(np.meshgrid(*axes_m, indexing="ij"), axis=-1)
    shape, flat_m = points_m.shape[:3], points_m.reshape(-1, 3)
    mask = organ.contains(flat_m).reshape(shape)
    held = np.any([body.contains(flat_m).reshape(shape) for body in bodies], axis=0)
    radius = int(np.ceil(TOUCH_M / spacing_m))
    steps = np.indices((2 * radius + 1,) * 3) - radius
    ball = (steps**2).sum(axis=0) <= radius**2
    # Beyond the gap the organ keeps its own clefts and cavities.
    near = np.asarray(binary_dilation(held, ball), dtype=bool)
    closed = filled(np.asarray(binary_closing(mask | held, ball), dtype=bool))
    mask |= held | (closed & near)
    T = np.diag([spacing_m] * 3 + [1.0])
    T[:3, 3] = low_m
    return surface_of(mask, T, ORGAN_SURFACE)


def _draw_inside(
    organ: Solid, tumour: Solid, name: str, n: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], float]:
    """Points even in the part of the tumour inside the organ, shape (n, 3), and the share of it outside."""
    kept: list[NDArray[np.float64]] = []
    n_kept = n_drawn = 0
    for _ in range(MAX_DRAWS):
        try:
            drawn = tumour.sample_inside(max(n, 1), rng)
        except MeshError as error:
            raise AnatomyError(f"{name}: has no interior; remove it or export it again") from error
        kept.append(drawn[organ.contains(drawn)])
        n_kept, n_drawn = n_kept + len(kept[-1]), n_drawn + len(drawn)
        inside_share = n_kept / n_drawn
        if inside_share < LEAST_INSIDE_SHARE:
            away_mm = float(SurfaceDistance(organ).distance_m(tumour.vertices_m).min()) * 1e3
            where = f", and it lies {away_mm:.0f} mm away" if n_kept == 0 and away_mm >= 0.5 else ""
            raise AnatomyError(
                f"{name}: only {inside_share:.0%} of it lies inside the organ, at least "
                f"{LEAST_INSIDE_SHARE:.0%} must{where}; check that both files share one frame and unit"
            )
        if n_kept >= n:
            break
    return np.concatenate(kept)[:n], 1.0 - n_kept / n_drawn

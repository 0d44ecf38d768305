"""The surface of a piece of the map, cut out of the field by marching cubes, and how it compares with another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit
from skimage.measure import marching_cubes

from sim.record.map_field import called_from
from sim.record.run_record import RunRecord
from sim.world.errors import MeshError
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance

POINTS_ACROSS = 36
"""Points of the grid along the longest side of what is cut out: a volume is then right to about 1 %."""
LEAST_SPACING_M = 0.0005
"""The grid is never finer than this."""
MARGIN = 3
"""Points of the grid beyond what is cut out, so that every surface closes."""
N_SURFACE_POINTS = 3000
"""Points strewn on each of two surfaces that are compared."""
PERCENTILE = 95.0
NO_TUMOUR = -6.0
"""Log-odds outside the organ, where a surface around tumour is to close."""

Field = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Grid:
    """Points in a box at one spacing."""

    low_m: NDArray[np.float64]
    spacing_m: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> Grid:
        """The grid over a box, fine enough for what the box holds, with a margin."""
        longest_m = float((high_m - low_m).max())
        spacing_m = max(longest_m / POINTS_ACROSS, LEAST_SPACING_M)
        n = np.ceil((high_m - low_m) / spacing_m).astype(int) + 1 + 2 * MARGIN
        return cls(low_m - MARGIN * spacing_m, spacing_m, (int(n[0]), int(n[1]), int(n[2])))

    def points_m(self) -> NDArray[np.float64]:
        """All points [m], shape (N, 3), x slowest."""
        indices = np.stack(np.meshgrid(*map(np.arange, self.shape), indexing="ij"), axis=-1).reshape(-1, 3)
        return self.low_m + indices * self.spacing_m

    def is_in(self, solid: Solid) -> NDArray[np.bool_]:
        """Which of the points lie in a solid, shape (N,)."""
        axes_m = [
            low_m + np.arange(n) * self.spacing_m for low_m, n in zip(self.low_m, self.shape, strict=True)
        ]
        places_m = np.stack(np.meshgrid(axes_m[0], axes_m[1], indexing="ij"), axis=-1).reshape(-1, 2)
        return solid.contains_in_columns(places_m, axes_m[2]).ravel()

    @property
    def cell_m3(self) -> float:
        """The volume for which each point stands [m^3]."""
        return self.spacing_m**3


@dataclass(frozen=True, eq=False, kw_only=True)
class Overlap:
    """Two bodies on one grid: what the map made of a tumour, and the tumour."""

    mapped_volume_m3: float
    mapped_centroid_m: NDArray[np.float64]
    centroid_error_m: float
    """Distance between the centroid of what was mapped and that of the tumour."""
    dice: float
    """Twice the common volume by the sum of both."""


def overlap(grid: Grid, is_mapped: NDArray[np.bool_], is_true: NDArray[np.bool_]) -> Overlap:
    """The overlap of a mapped body with a true one; both hold at least one point.

    Args:
        grid: The points at which both were looked at.
        is_mapped: Which of these the map calls tumour, shape (N,).
        is_true: Which of these lie in the tumour, shape (N,).
    """
    points_m = grid.points_m()
    mapped_m, true_m = points_m[is_mapped].mean(axis=0), points_m[is_true].mean(axis=0)
    return Overlap(
        mapped_volume_m3=float(is_mapped.sum()) * grid.cell_m3,
        mapped_centroid_m=mapped_m,
        centroid_error_m=float(np.linalg.norm(mapped_m - true_m)),
        dice=float(2 * (is_mapped & is_true).sum() / (is_mapped.sum() + is_true.sum())),
    )


def surface_of(grid: Grid, values: NDArray[np.float64]) -> Solid | None:
    """The surface on which a field is 0, turned outward from where it is positive; None without such a surface.

    Args:
        grid: The points at which the field is known; at the outermost it has to be negative.
        values: The field at these points, shape (N,).
    """
    block = values.reshape(grid.shape)
    if not (block > 0).any() or not (block < 0).any():
        return None
    vertices, faces, _, _ = marching_cubes(block, level=0.0)
    try:
        return Solid(grid.low_m + vertices * grid.spacing_m, faces[:, ::-1])
    except MeshError:
        return None


def surface_after(record: RunRecord, step: int) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """The surface around what a run's map called tumour after an action, or None where that map was not kept.

    Args:
        record: The run, or its second class.
        step: The action, from 1 on.

    Returns:
        Vertices, world frame [m], shape (V, 3), and triangles, shape (F, 3); none where the map called nothing tumour.
    """
    field = record.field
    if field is None or step not in record.history:
        return None
    level = float(logit(called_from(record.config["map"]["prior_prevalence"])))
    block = np.full(field.is_inside.shape, NO_TUMOUR)
    block[field.is_inside] = record.history[step]
    block = np.pad(block - level, 1, constant_values=NO_TUMOUR)
    if not (block > 0).any():
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    vertices, faces, _, _ = marching_cubes(block, level=0.0)
    return field.low_m + (vertices - 1) * field.cell_m, faces[:, ::-1].astype(np.int64)


def surface_gap(one: Solid, other: Solid, rng: np.random.Generator) -> tuple[float, float]:
    """The mean distance between two surfaces [m], and the 95th percentile, the larger of both ways (Hausdorff)."""
    ways = [_distances_m(one, other, rng), _distances_m(other, one, rng)]
    mean_m = float(np.mean([way.mean() for way in ways]))
    return mean_m, float(max(np.percentile(way, PERCENTILE) for way in ways))


def _distances_m(source: Solid, target: Solid, rng: np.random.Generator) -> NDArray[np.float64]:
    """The distances to a surface from points strewn evenly on another [m], shape (N_SURFACE_POINTS,)."""
    return SurfaceDistance(target).distance_m(_strewn(source, rng))


def _strewn(solid: Solid, rng: np.random.Generator) -> NDArray[np.float64]:
    areas = solid.face_areas_m2()
    faces = rng.choice(len(areas), size=N_SURFACE_POINTS, p=areas / areas.sum())
    a, b, c = (solid.vertices_m[solid.faces[faces, i]] for i in range(3))
    u, v = rng.random((2, N_SURFACE_POINTS, 1))
    is_over = u + v > 1
    u, v = np.where(is_over, 1 - u, u), np.where(is_over, 1 - v, v)
    return a + u * (b - a) + v * (c - a)

"""From a mask of voxels to a smooth closed surface of the same volume.

The mask is blurred by about a voxel, which turns its steps into a smooth field, and brought to even spacing. Marching
cubes (Lorensen and Cline, 1987; scikit-image's topologically sound variant) draws the level of that field which
encloses the voxels' own volume: at the level of one half, blurring would shrink small and thin parts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, zoom
from skimage import measure

from sim.world.errors import MeshError
from sim.world.meshes.decimation import decimate
from sim.world.meshes.repair import RepairError, repair
from sim.world.meshes.topology import signed_volume_m3
from sim.world.solids.solid import Solid

LEAST_BLUR_VOXELS = 0.8
"""Least standard deviation of the blur along each axis, in voxels: with less the voxels' steps stay."""

LEAST_BLUR_M = 0.8e-3
"""The blur is at least this wide [m]: between thin slices the steps are the jitter of their outlines."""

MARGIN_SIGMAS = 4.0
"""Empty voxels are kept about the mask as wide as this many standard deviations of the blur."""

MOST_CELLS = 12_000_000
"""Most points of the even grid, which is coarsened to that."""

VOLUME_TOLERANCE = 2e-3
"""Share of the voxels' volume by which the surface's may differ."""

N_LEVELS = 6
"""Levels tried until the volume fits; three usually do."""


@dataclass(frozen=True, kw_only=True)
class SurfaceSettings:
    """How finely a surface is drawn."""

    spacing_m: float
    """Spacing of the even grid [m]."""
    n_triangles: int
    """Most triangles of the surface."""


ORGAN_SURFACE = SurfaceSettings(spacing_m=1.5e-3, n_triangles=20_000)
STRUCTURE_SURFACE = SurfaceSettings(spacing_m=1.2e-3, n_triangles=12_000)


def tumour_surface(diameter_m: float) -> SurfaceSettings:
    """The settings for a tumour: fine enough that a small one is round."""
    return SurfaceSettings(spacing_m=float(np.clip(diameter_m / 14.0, 0.4e-3, 1.5e-3)), n_triangles=4_000)


def surface_of(mask: NDArray[np.bool_], T_lps_voxel: NDArray[np.float64], settings: SurfaceSettings) -> Solid:
    """The smooth closed surface of a mask, with the volume of its voxels.

    Args:
        mask: Which voxels belong to the structure, shape (I, J, K), at least one.
        T_lps_voxel: Affine map of the mask's indices to patient axes [m].
        settings: How finely to draw.

    Returns:
        The solid in patient axes [m].

    Raises:
        MeshError: No closed surface could be drawn.
    """
    field, T_lps_grid = _even_field(mask, T_lps_voxel, settings.spacing_m)
    volume_m3 = int(mask.sum()) * abs(float(np.linalg.det(T_lps_voxel[:3, :3])))
    cell_m3 = abs(float(np.linalg.det(T_lps_grid[:3, :3])))
    descending = np.sort(field, axis=None)[::-1]
    aim_cells, best = volume_m3 / cell_m3, None
    for _ in range(N_LEVELS):
        level = _level(descending, aim_cells)
        vertices, faces, _, _ = measure.marching_cubes(field, level)
        vertices_m = vertices.astype(np.float64) @ T_lps_grid[:3, :3].T + T_lps_grid[:3, 3]
        drawn_m3 = abs(signed_volume_m3(vertices_m, faces))
        error = drawn_m3 / volume_m3 - 1.0
        if best is None or abs(error) < best[0]:
            best = abs(error), vertices_m, faces
        if abs(error) < VOLUME_TOLERANCE:
            break
        aim_cells *= float(np.clip(1.0 / (1.0 + error), 0.5, 2.0))
    assert best is not None
    return _closed(best[1], np.asarray(best[2], dtype=np.int64), settings.n_triangles)


def _even_field(
    mask: NDArray[np.bool_], T_lps_voxel: NDArray[np.float64], spacing_m: float
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """The blurred mask on an even grid, 0 along its border, and the map of its indices to the patient."""
    steps_m = np.linalg.norm(T_lps_voxel[:3, :3], axis=0)
    sigma = np.maximum(LEAST_BLUR_VOXELS, LEAST_BLUR_M / steps_m)
    margin = np.ceil(MARGIN_SIGMAS * sigma).astype(int)
    padded = np.pad(mask.astype(np.float32), [(int(n), int(n)) for n in margin])
    blurred = gaussian_filter(padded, sigma, truncate=MARGIN_SIGMAS)
    shape = np.array(blurred.shape)
    wanted = np.maximum(np.rint((shape - 1) * steps_m / spacing_m).astype(int) + 1, 3)
    if excess := max(np.prod(wanted.astype(float)) / MOST_CELLS, 1.0) - 1.0:
        wanted = np.maximum((wanted / np.cbrt(1.0 + excess)).astype(int), 3)
    is_finer = bool((wanted > shape).any())
    field = np.asarray(zoom(blurred, wanted / shape, order=3 if is_finer else 1, mode="nearest"), np.float32)
    # With a border of zeros the surface closes within the grid.
    for axis in range(3):
        border = np.moveaxis(field, axis, 0)
        border[[0, -1]] = 0.0
    T = np.array(T_lps_voxel, dtype=np.float64)
    T[:3, 3] -= T_lps_voxel[:3, :3] @ margin
    T[:3, :3] = T_lps_voxel[:3, :3] * ((shape - 1) / (np.array(field.shape) - 1))
    return field, T


def _level(descending: NDArray[np.float32], n_cells: float) -> float:
    """The value that about so many cells exceed, strictly between the field's least and greatest."""
    index = int(np.clip(round(n_cells), 1, len(descending) - 1))
    level = 0.5 * (float(descending[index - 1]) + float(descending[index]))
    top = float(descending[0])
    return float(np.clip(level, 1e-4 * top, (1.0 - 1e-4) * top))


def _closed(vertices_m: NDArray[np.float64], faces: NDArray[np.int64], n_triangles: int) -> Solid:
    """The surface repaired and with few enough triangles."""
    try:
        vertices_m, faces, _ = repair(vertices_m, faces)
    except RepairError as error:
        raise MeshError(f"no closed surface could be drawn about the label: {error}") from error
    vertices_m, faces = decimate(vertices_m, faces, n_triangles) or (vertices_m, faces)
    return Solid(vertices_m, faces)

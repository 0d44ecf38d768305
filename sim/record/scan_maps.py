"""The map on the grid of the scan that the organ came from: a value for each of its voxels, so that it lies over it.

Between the points of the map's lattice, log-odds are interpolated linearly; which voxels lie in the organ is decided by
its true surface. Probabilities are kept in steps of 0.004, a byte a voxel: a scan may have a hundred million.
"""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.special import expit, logit

from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.solid import Solid
from sim.world.volumes.files import is_volume, read_grid

from .map_field import SURE, extended
from .map_volumes import RAS_MM_FROM_LPS_M, UNSEEABLE, MapArrays

STEP = 0.004
"""Probability between two values of a byte: 250 of them are a probability of 1."""
COMPRESSION = 4
"""Most voxels are 0, and more effort saves little."""
VOXELS_AT_ONCE = 2_000_000
MARGIN_M = 0.008
"""The distances to the surface reach this far beyond the organ's box."""
SHEAR_MM = 0.1
"""Where a qform, which holds no shear, would put a voxel farther off than this, none is written."""
HEADER_BYTES = 352


@dataclass(frozen=True, eq=False, kw_only=True)
class ScanGrid:
    """The voxels of a scan."""

    shape: tuple[int, int, int]
    """Their numbers along the axes."""
    T_lps_voxel: NDArray[np.float64]
    """Maps indices to patient axes, LPS [m], shape (4, 4)."""


def scan_map_volumes(
    arrays: MapArrays, organ: Solid, T_world_organ: NDArray[np.float64], grid: ScanGrid, *, threshold: float
) -> dict[str, bytes]:
    """The files of a map on a scan's grid by name, with their contents; the same map gives the same bytes.

    Args:
        arrays: The map.
        organ: The organ's surface, world frame [m].
        T_world_organ: Maps patient axes (LPS) [m] to the world, shape (4, 4).
        grid: The scan's voxels.
        threshold: Probability above which a voxel gets the label of what is mapped.
    """
    probability, labels = map_on_grid(arrays, organ, T_world_organ, grid, threshold=threshold)
    stem, noun = f"{arrays.of.file_stem}_on_scan", arrays.of.noun
    affine = RAS_MM_FROM_LPS_M @ grid.T_lps_voxel
    return {
        f"{stem}_probability.nii.gz": _nifti(probability, affine, f"probability of {noun}", slope=STEP),
        f"{stem}_labels.nii.gz": _nifti(labels, affine, arrays.label_text(threshold)),
    }


def map_on_grid(
    arrays: MapArrays, organ: Solid, T_world_organ: NDArray[np.float64], grid: ScanGrid, *, threshold: float
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The probability in steps of `STEP`, and the label, of each voxel of a grid, both of the grid's shape.

    Args:
        arrays: The map.
        organ: The organ's surface, world frame [m].
        T_world_organ: Maps patient axes (LPS) [m] to the world, shape (4, 4).
        grid: The voxels.
        threshold: Probability above which a voxel gets the label of what is mapped.
    """
    probability, labels = np.zeros(grid.shape, np.uint8), np.zeros(grid.shape, np.uint8)
    T_world_voxel = T_world_organ @ grid.T_lps_voxel
    box = _box_around(organ, T_world_voxel, grid.shape)
    log_odds = _filled_log_odds(arrays)
    surface = DistanceGrid.from_solid(organ, margin_m=MARGIN_M)
    for part in _slabs(box):
        index = np.stack(np.meshgrid(*(np.arange(s.start, s.stop) for s in part), indexing="ij"), axis=-1)
        points_m = index.reshape(-1, 3) @ T_world_voxel[:3, :3].T + T_world_voxel[:3, 3]
        inside = np.flatnonzero(surface.distance_m(points_m) < 0.0)
        places = _lattice_places(arrays, points_m[inside])
        likely = expit(map_coordinates(log_odds, places, order=1, mode="nearest"))
        found, values = np.zeros(len(points_m), np.uint8), np.zeros(len(points_m), np.uint8)
        values[inside] = np.rint(likely / STEP)
        found[inside] = np.where(likely > threshold, arrays.of.label, _organ_label(arrays, places))
        probability[part], labels[part] = (each.reshape(index.shape[:3]) for each in (values, found))
    return probability, labels


def _filled_log_odds(arrays: MapArrays) -> NDArray[np.float64]:
    """Log-odds on the lattice; outside the organ those of the nearest point inside."""
    known = np.where(arrays.is_inside, arrays.probability, 0.5).astype(np.float64)
    return extended(logit(np.clip(known, SURE, 1.0 - SURE)), arrays.is_inside)


def _organ_label(arrays: MapArrays, places: NDArray[np.float64]) -> NDArray[np.uint8]:
    """1 for organ that some cone holds and `UNSEEABLE` for the rest, by the nearest point of the lattice."""
    if arrays.is_visible is None:
        return np.ones(places.shape[1], np.uint8)
    is_visible = extended(arrays.is_visible.astype(np.float64), arrays.is_inside) > 0.5
    nearest = np.rint(places).astype(np.intp)
    nearest = np.clip(nearest, 0, np.array(is_visible.shape)[:, None] - 1)
    return np.where(is_visible[tuple(nearest)], 1, UNSEEABLE).astype(np.uint8)


def _lattice_places(arrays: MapArrays, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The fractional indices of points on the lattice, shape (3, N)."""
    low_m = np.array([axis[0] for axis in arrays.axes_m])
    cell_m = np.array([axis[1] - axis[0] if len(axis) > 1 else 1.0 for axis in arrays.axes_m])
    return ((points_m - low_m) / cell_m).T


def _box_around(
    organ: Solid, T_world_voxel: NDArray[np.float64], shape: tuple[int, int, int]
) -> tuple[slice, slice, slice]:
    """The part of a scan's voxels that the organ lies in."""
    T = np.linalg.inv(T_world_voxel)
    index = organ.vertices_m @ T[:3, :3].T + T[:3, 3]
    low = np.clip(np.floor(index.min(axis=0)).astype(int), 0, shape)
    high = np.clip(np.ceil(index.max(axis=0)).astype(int) + 1, 0, shape)
    first, second, third = (slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    return first, second, third


def _slabs(box: tuple[slice, slice, slice]) -> list[tuple[slice, slice, slice]]:
    """A box in parts of some `VOXELS_AT_ONCE` voxels, across the last axis."""
    first, second, third = box
    layer = max((first.stop - first.start) * (second.stop - second.start), 1)
    step = max(VOXELS_AT_ONCE // layer, 1)
    starts = range(third.start, third.stop, step)
    return [(first, second, slice(at, min(at + step, third.stop))) for at in starts]


def _nifti(values: NDArray[Any], affine: NDArray[np.float64], text: str, *, slope: float = 1.0) -> bytes:
    """A NIfTI file of bytes that stand for values by a slope; its qform and sform agree."""
    import nibabel

    header = nibabel.Nifti1Header()
    header.set_data_dtype(values.dtype)
    header.set_data_shape(values.shape)
    header.set_xyzt_units("mm")
    header.set_sform(affine, code=1)
    header.set_qform(affine, code=1)
    corner = np.array([*values.shape, 1.0])
    qform = cast("NDArray[np.float64]", header.get_qform())
    if np.linalg.norm((qform - affine) @ corner) > SHEAR_MM:
        header["qform_code"] = 0
    header.set_slope_inter(slope, 0.0)
    header["descrip"] = f"Sounding: {text}"[:79].encode("ascii", "replace")
    header["magic"], header["vox_offset"] = b"n+1", HEADER_BYTES
    start = header.binaryblock.ljust(HEADER_BYTES, b"\0")
    return gzip.compress(start + values.tobytes(order="F"), COMPRESSION, mtime=0)


def scan_grid_of(config: Mapping[str, Any]) -> ScanGrid | None:
    """The grid of the scan that a recorded organ came from, by its header; None where it came from no volume.

    Args:
        config: The run's config.json.

    Raises:
        VolumeError: The file is not there any more, or cannot be read.
    """
    files = config["scenario"].get("files")
    if not isinstance(files, dict) or not is_volume(str(files["organ"])):
        return None
    named = [files["organ"], config["options"].get("organ")]
    path = next((each for each in named if each and Path(each).exists()), files["organ"])
    spacing_m = files.get("spacing_m")
    shape, T_lps_voxel = read_grid(
        path,
        spacing_m=None if spacing_m is None else (spacing_m[0], spacing_m[1], spacing_m[2]),
        axes=files.get("voxel_axes"),
    )
    return ScanGrid(shape=shape, T_lps_voxel=T_lps_voxel)

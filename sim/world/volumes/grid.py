"""What the header of a label volume claims, and whether that can be: sizes, types and axes, before a voxel is read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import VolumeError
from sim.world.memory import spare_bytes

METRES_PER_UNIT = {
    "mm": 1e-3,
    "millimeter": 1e-3,
    "millimeters": 1e-3,
    "meter": 1.0,
    "m": 1.0,
    "micron": 1e-6,
}
"""Of the units that headers name."""

BYTES_PER_VOXEL = 4
"""Where all of a volume is labelled, its labels are in memory twice, in parts and together."""

MOST_DEFLATED = 1040
"""No gzip stream unfolds to more bytes per byte than this; a file that claims more is cut short."""

SPACING_RANGE_M = (0.02e-3, 30e-3)
"""Distances between voxels that a scan of a liver may have [m]."""

FLAT_DETERMINANT = 1e-3
"""Least volume of a voxel as a share of the product of its edges; below, the axes lie in one plane."""


@dataclass(kw_only=True)
class Grid:
    """What a header says, and how to read the voxels."""

    shape: tuple[int, ...]
    """Numbers of voxels along the axes, of which there need not be three."""
    dtype: np.dtype[Any]
    """Type of the voxels in the file."""
    T_lps_voxel: NDArray[np.float64]
    """Affine map of voxel indices to patient axes [m], shape (4, 4)."""
    layers: Callable[[int], Iterator[NDArray[Any]]]
    """Reads the voxels from the first to the last, in parts of so many layers across the last axis, shape (I, J, n)."""
    is_streamed: bool = False
    """Whether no part that was read is kept."""
    slope: float = 1.0
    """Factor of the values."""
    intercept: float = 0.0
    """What is added to them after."""
    notices: list[str] = field(default_factory=list)
    """One sentence for each thing assumed."""
    label_names: dict[int, str] = field(default_factory=dict)
    """Names of labels that the file gives."""
    overlaps: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """Numbers that stand for several labels at once; filled as layers are read."""
    bytes_per_voxel: int | None = None
    """What a voxel takes in the file, where that is not what its type takes."""
    data_path: Path | None = None
    """The file of the voxels, where it is not the header's."""
    is_compressed: bool = False
    """Whether the voxels are packed in the file."""


def check_shape(path: Path, grid: Grid) -> tuple[int, int, int]:
    """The three sizes of the grid.

    Raises:
        VolumeError: It has no three axes, no voxels, numbers that are no labels, or too many voxels.
    """
    shape = tuple(n for axis, n in enumerate(grid.shape) if axis < 3 or n != 1)
    if len(shape) != 3:
        raise VolumeError(
            f"{path}: has {len(grid.shape)} axes, of {' x '.join(map(str, grid.shape))}; a label volume has "
            "three. Save one of its volumes, with one label per voxel"
        )
    if min(shape) < 2:
        raise VolumeError(f"{path}: {' x '.join(map(str, shape))} voxels are no volume; save the whole scan")
    if grid.dtype.kind not in "iuf":
        raise VolumeError(
            f"{path}: its voxels are of type {grid.dtype}; save whole numbers, one label per voxel"
        )
    n_voxels = shape[0] * shape[1] * shape[2]
    stored = grid.bytes_per_voxel or grid.dtype.itemsize
    per_voxel = BYTES_PER_VOXEL + (0 if grid.is_streamed else stored)
    n_bytes, memory = n_voxels * per_voxel, spare_bytes()
    if n_bytes > memory:
        raise VolumeError(
            f"{path}: {' x '.join(map(str, shape))} voxels may take {n_bytes / 2**30:.3g} GiB, more than the "
            f"{memory / 2**30:.2g} GiB that this machine can spare; crop it to the organ or resample it"
        )
    n_file_bytes = (grid.data_path or path).stat().st_size
    size = n_file_bytes * (MOST_DEFLATED if grid.is_compressed else 1)
    if path.suffix.lower() != ".nhdr" and n_voxels * stored > size:
        raise VolumeError(
            f"{path}: the file is cut short: its {n_file_bytes:,} bytes cannot hold "
            f"{' x '.join(map(str, shape))} voxels; copy or download it again"
        )
    return shape[0], shape[1], shape[2]


def check_affine(path: Path, grid: Grid, spacing_m: tuple[float, float, float] | None) -> NDArray[np.float64]:
    """The map of voxels to the patient, with the spacing that is given.

    Args:
        path: The file, for messages.
        grid: What its header says.
        spacing_m: Distances between voxels in place of the header's [m], or None.

    Raises:
        VolumeError: It is not finite, flat, or of an impossible spacing.
    """
    T = grid.T_lps_voxel.copy()
    lengths = np.linalg.norm(T[:3, :3], axis=0)
    is_usable = np.isfinite(T).all() and (lengths > 0.0).all()
    if spacing_m is not None:
        T = T if is_usable else np.eye(4)
        T[:3, :3] *= np.asarray(spacing_m) / (lengths if is_usable else 1.0)
        is_usable, lengths = True, np.asarray(spacing_m, dtype=np.float64)
    low, high = SPACING_RANGE_M
    if not is_usable or not ((lengths >= low) & (lengths <= high)).all():
        raise VolumeError(
            f"{path}: the voxels are {' x '.join(f'{length * 1e3:.3g}' for length in lengths)} mm by the header, "
            f"outside {low * 1e3:g}..{high * 1e3:g} mm; pass the scan's own as `spacing_mm` X Y Z"
        )
    if abs(np.linalg.det(T[:3, :3])) < FLAT_DETERMINANT * lengths.prod():
        raise VolumeError(f"{path}: the header's axes lie in one plane; export the volume again")
    if np.abs(T[:3, 3]).max() > 100.0:
        raise VolumeError(
            f"{path}: the header puts the volume {np.abs(T[:3, 3]).max():.3g} m away; export it again"
        )
    return T

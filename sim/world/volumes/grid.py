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

from .masks import box_of
from .volume import Volume, directions_of

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

LIVER_MM = (199.0, 172.0, 162.0)
"""Usual extents of a liver from left to right, front to back and foot to head, as LiTS has them."""

HEIGHT_RANGE = (0.4, 1.5)
"""From foot to head a liver measures this many times what it does across: 0.6 to 1.0 of 9 real ones."""

WIDEST_CT = 512
"""No CT sees this many millimetres across; its pictures have as many voxels."""

BULK_OFFSET = 0.03
"""How far off the middle of its box, as a share of it, a liver's centre lies: 0.1 to the right, 0.04 to 0.13 up."""

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


def check_affine(
    path: Path, grid: Grid, spacing_m: tuple[float, float, float] | None, axes: str | None = None
) -> NDArray[np.float64]:
    """The map of voxels to the patient, with the spacing and the axes that are given.

    Args:
        path: The file, for messages.
        grid: What its header says.
        spacing_m: Distances between voxels in place of the header's [m], or None.
        axes: Where the axes run in place of the header's, as RAS, or None.

    Raises:
        VolumeError: It is not finite, flat, or of an impossible spacing, or the axes given are none.
    """
    T = grid.T_lps_voxel.copy()
    if axes is not None:
        directions = directions_of(axes)
        if directions is None:
            raise VolumeError(
                f"`voxel_axes` {axes!r}: three letters, one of R and L, one of A and P, one of I and S"
            )
        T[:3, :3] = directions * np.linalg.norm(T[:3, :3], axis=0)
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


def remarks_on_lost_header(volume: Volume, organ: NDArray[np.bool_], *, is_implausible: bool) -> list[str]:
    """A sentence, where the header of a volume seems to be lost, with what it may have been.

    Args:
        volume: The volume.
        organ: The organ's voxels, shape (I, J, K).
        is_implausible: Whether the organ has a volume that a liver has not.
    """
    if not volume.is_bare or volume.is_turned:
        return []
    axes = f"by the organ's shape, of which the bulk lies to the right and the head, {_axes_by_shape(organ)}"
    if volume.is_respaced:
        return [
            "its header's voxels of 1 x 1 x 1 mm are those of a lost header, and its axes are probably lost as well: "
            f"check left and right, front and back, and pass the scan's own as `voxel_axes`; {axes}"
        ]
    extents = np.array(organ[box_of(organ)].shape)
    height = extents[2] / np.sqrt(extents[0] * extents[1])
    reasons = ["no liver has such a size"] if is_implausible else []
    if min(volume.scan_shape[:2]) >= WIDEST_CT:
        reasons.append(f"{volume.scan_shape[0]} mm are wider than a CT sees")
    if not HEIGHT_RANGE[0] <= height <= HEIGHT_RANGE[1]:
        reasons.append(f"the organ is {height:.2g} times as high as it is wide")
    if not reasons:
        return []
    plane_mm = np.sqrt(LIVER_MM[0] * LIVER_MM[1] / (extents[0] * extents[1]))
    return [
        f"its header says 1 x 1 x 1 mm, which is what a lost header says, and {' and '.join(reasons)}: pass the scan's "
        f"own spacing as `spacing_mm` X Y Z, and its axes as `voxel_axes`. A liver of usual size would have voxels of "
        f"about {plane_mm:.1g} x {plane_mm:.1g} x {LIVER_MM[2] / extents[2]:.1g} mm, and axes, {axes}"
    ]


def _axes_by_shape(organ: NDArray[np.bool_]) -> str:
    """Where the axes of a volume run if it holds a liver: its bulk lies to the right and towards the head."""
    part = organ[box_of(organ)]
    weights = {"across": part.sum(axis=(1, 2)), "along": part.sum(axis=(0, 1))}
    off = {
        name: float(np.average(np.arange(len(each)), weights=each)) / max(len(each) - 1, 1) - 0.5
        for name, each in weights.items()
    }
    across = "L" if off["across"] < -BULK_OFFSET else "R" if off["across"] > BULK_OFFSET else "LR"
    along = "S" if off["along"] > BULK_OFFSET else "I" if off["along"] < -BULK_OFFSET else "SI"
    letters = [f"{x}{y}{z}" for x in across for y in "PA" for z in along]
    return " or ".join(letters) if len(letters) < 4 else "which it does not tell"

"""Reading label volumes: NIfTI and NRRD files. Nothing is read before its size is known.

What a file claims is checked against memory and against the file's own size first, so that neither a damaged header
nor a decompression bomb can exhaust the machine.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace
from pathlib import Path

import nrrd
import numpy as np
from nibabel.filebasedimages import ImageFileError
from nibabel.spatialimages import HeaderDataError, HeaderTypeError, ImageDataError
from nibabel.wrapstruct import WrapStructError

from sim.world.errors import VolumeError

from .grid import check_affine, check_shape
from .label_values import read_labels
from .nifti_files import read_nifti
from .nrrd_files import read_nrrd
from .volume import Volume, shifted

SUFFIXES = (".nii", ".nii.gz", ".nrrd", ".nhdr")

READER_ERRORS = (
    *(ValueError, TypeError, LookupError, ArithmeticError, AttributeError, AssertionError, RuntimeError),
    *(OSError, EOFError, MemoryError, StopIteration, zlib.error, struct.error),
    *(ImageFileError, HeaderDataError, HeaderTypeError, ImageDataError, WrapStructError, nrrd.NRRDError),
)
"""What the readers may raise when fed with arbitrary bytes."""


def is_volume(path: str | Path) -> bool:
    """Whether a path is named like a label volume."""
    return str(path).lower().endswith(SUFFIXES)


def load_volume(path: str | Path, *, spacing_m: tuple[float, float, float] | None = None) -> Volume:
    """The label volume of a file.

    Args:
        path: A .nii, .nii.gz, .nrrd or .nhdr file.
        spacing_m: Distances between voxels [m] in place of the header's, where that is known to be wrong.

    Returns:
        The labels in patient axes, and what is remarkable about the file.

    Raises:
        VolumeError: The file cannot be read, is too large, or holds no labels.
    """
    path = Path(path)
    if not path.is_file():
        raise VolumeError(f"{path}: there is no such file; check the path")
    if not is_volume(path):
        raise VolumeError(f"{path}: not read as a label volume; convert to one of {', '.join(SUFFIXES)}")
    try:
        grid = read_nifti(path) if str(path).lower().endswith((".nii", ".nii.gz")) else read_nrrd(path)
        shape = check_shape(path, grid)
        T_lps_voxel = check_affine(path, grid, spacing_m)
        found = read_labels(
            path, grid.layers, shape, dtype=grid.dtype, slope=grid.slope, intercept=grid.intercept
        )
    except VolumeError:
        raise
    except READER_ERRORS as error:
        raise _unreadable(path, error) from error
    volume = Volume(
        labels=found.labels, T_lps_voxel=shifted(T_lps_voxel, found.box), box=found.box, scan_shape=shape,
        counts=found.counts, name=path.name, label_names=grid.label_names,
    )  # fmt: skip
    notices = [*grid.notices, *found.remarks]
    if volume.is_oblique:
        degrees = np.rad2deg(volume.obliquity_rad)
        notices.append(f"the scan is oblique by {degrees:.1f} degrees, which its axes take into account")
    return replace(volume, notices=tuple(f"{path.name}: {notice}" for notice in notices))


def _unreadable(path: Path, error: BaseException) -> VolumeError:
    kind = "NRRD" if path.suffix.lower() in (".nrrd", ".nhdr") else "NIfTI"
    reason = (str(error).splitlines() or [""])[0][:160].rstrip(".")
    if isinstance(error, EOFError | zlib.error) or "Expected" in reason or "mmap length" in reason:
        return VolumeError(f"{path}: the file is cut short or damaged ({reason}); copy or download it again")
    return VolumeError(
        f"{path}: cannot be read as {kind} ({type(error).__name__}: {reason}); export the label volume again"
    )

"""Reading label volumes: NIfTI and NRRD files, and segmentations in DICOM. Nothing is read before its size is known.

What a file claims is checked against memory and against the file's own size first, so that neither a damaged header
nor a decompression bomb can exhaust the machine.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import VolumeError

from .grid import Grid, check_affine, check_shape
from .label_values import read_labels
from .volume import Volume, counts_with_overlaps, is_bare, shifted

SUFFIXES = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".hdr", ".img", ".img.gz", ".mgz", ".mgh")
"""Endings of files that are read."""

KINDS = {".nrrd": "NRRD", ".nhdr": "NRRD", ".mgz": "FreeSurfer's MGH", ".mgh": "FreeSurfer's MGH"}
"""What files are called in messages; the others are NIfTI."""

UNREAD = (
    *(".mha", ".mhd", ".dcm", ".dicom", ".ima", ".gipl", ".gipl.gz", ".mnc", ".vti", ".nii.bz2", ".nii.zip"),
    *(".tif", ".tiff", ".npy", ".npz", ".mat", ".h5", ".hdf5", ".mrb", ".raw"),
)
"""Endings of label volumes that are not read."""

DICOM_ENDINGS = (".dcm", ".dicom", ".ima")
DICOM_START, DICOM_MAGIC = 128, b"DICM"

MOST_LOOKED_AT = 20
"""Files of a folder that are looked at for DICOM."""

HOW_DICOM = (
    "of DICOM only a SEG object is read, a file by itself; load others with 3D Slicer's DICOM module and save the "
    "segmentation as .seg.nrrd or .nii.gz (an RTSTRUCT needs the extension SlicerRT)"
)

HOW = (
    "is not read; save it as .nii.gz or .nrrd, in 3D Slicer by Add Data and Save, or in Python with SimpleITK: "
    "WriteImage(ReadImage('{name}'), 'labels.nii.gz')"
)


def reader_errors() -> tuple[type[BaseException], ...]:
    """What the readers may raise when fed with arbitrary bytes.

    Here and below their libraries are imported where a volume is read: most commands read none and would wait for them.
    """
    import nrrd
    from nibabel.filebasedimages import ImageFileError
    from nibabel.spatialimages import HeaderDataError, HeaderTypeError, ImageDataError
    from nibabel.wrapstruct import WrapStructError

    return (
        *(ValueError, TypeError, LookupError, ArithmeticError, AttributeError, AssertionError, RuntimeError),
        *(OSError, EOFError, MemoryError, StopIteration, zlib.error, struct.error),
        *(ImageFileError, HeaderDataError, HeaderTypeError, ImageDataError, WrapStructError, nrrd.NRRDError),
    )


def is_volume(path: str | Path) -> bool:
    """Whether a path is that of a label volume, of a format that is read or of another, by its name or as DICOM."""
    return str(path).lower().endswith((*SUFFIXES, *UNREAD)) or is_dicom(Path(path))


def files_of(path: Path) -> tuple[Path, ...]:
    """The files that a body is read from: that which is named, and one beside it that holds a header's voxels.

    Raises:
        VolumeError: The header cannot be read, or the other file is not there.
    """
    ending = path.suffix.lower()
    if not path.is_file() or ending not in (".hdr", ".img", ".nhdr"):
        return (path,)
    try:
        if ending == ".nhdr":
            from .nrrd_files import voxel_file

            return path, voxel_file(path)
        from .nifti_files import pair_of

        return pair_of(path)
    except reader_errors() as error:
        raise _unreadable(path, error) from error


def is_dicom(path: Path) -> bool:
    """Whether a path is that of a DICOM file, or of a folder of some."""
    if path.is_dir():
        files = [each for each in sorted(path.iterdir()) if each.is_file()]
        return any(is_dicom(each) for each in files[:MOST_LOOKED_AT])
    if path.name.lower().endswith(DICOM_ENDINGS):
        return True
    try:
        with path.open("rb") as file:
            return file.read(DICOM_START + len(DICOM_MAGIC))[DICOM_START:] == DICOM_MAGIC
    except OSError:
        return False


def load_volume(
    path: str | Path, *, spacing_m: tuple[float, float, float] | None = None, axes: str | None = None
) -> Volume:
    """The label volume of a file.

    Args:
        path: A .nii, .nii.gz, .nrrd, .nhdr, .mgz or .mgh file, one of a pair of .hdr and .img, or a DICOM SEG.
        spacing_m: Distances between voxels [m] in place of the header's, where that is known to be wrong.
        axes: Where the voxels' axes run, for example RAS, in place of the header's.

    Returns:
        The labels in patient axes, and what is remarkable about the file.

    Raises:
        VolumeError: The file cannot be read, is too large, or holds no labels.
    """
    path = Path(path)
    _check_is_read(path)
    try:
        grid = _read(path)
        shape = check_shape(path, grid)
        T_lps_voxel = check_affine(path, grid, spacing_m, axes)
        found = read_labels(
            path, grid.layers, shape, dtype=grid.dtype, slope=grid.slope, intercept=grid.intercept
        )
    except VolumeError:
        raise
    except reader_errors() as error:
        raise _unreadable(path, error) from error
    volume = Volume(
        labels=found.labels, T_lps_voxel=shifted(T_lps_voxel, found.box), box=found.box, scan_shape=shape,
        counts=counts_with_overlaps(found.counts, grid.overlaps), name=path.name, label_names=grid.label_names,
        overlaps=grid.overlaps, is_bare=is_bare(grid.T_lps_voxel), is_respaced=spacing_m is not None,
        is_turned=axes is not None,
    )  # fmt: skip
    notices = [*grid.notices, *found.remarks]
    if volume.is_oblique:
        degrees = np.rad2deg(volume.obliquity_rad)
        notices.append(f"the scan is oblique by {degrees:.1f} degrees, which its axes take into account")
    return replace(volume, notices=tuple(f"{path.name}: {notice}" for notice in notices))


def read_grid(
    path: str | Path, *, spacing_m: tuple[float, float, float] | None = None, axes: str | None = None
) -> tuple[tuple[int, int, int], NDArray[np.float64]]:
    """The numbers of voxels of a file and their map to patient axes [m], by its header alone.

    Args:
        path: The file; see `load_volume`.
        spacing_m: Distances between voxels [m] in place of the header's.
        axes: Where the voxels' axes run, for example RAS, in place of the header's.

    Raises:
        VolumeError: The header cannot be read.
    """
    path = Path(path)
    _check_is_read(path)
    try:
        grid = _read(path)
        return check_shape(path, grid), check_affine(path, grid, spacing_m, axes)
    except VolumeError:
        raise
    except reader_errors() as error:
        raise _unreadable(path, error) from error


def _check_is_read(path: Path) -> None:
    """Nothing, if a path is that of a file of a format that is read.

    Raises:
        VolumeError: It is not, with what to do.
    """
    if not path.exists():
        raise VolumeError(f"{path}: there is no such file; check the path")
    if is_dicom(path):
        from .dicom.segmentation import is_segmentation

        if path.is_file() and is_segmentation(path):
            return
        raise VolumeError(f"{path}: {'is a folder of DICOM files. ' if path.is_dir() else ''}{HOW_DICOM}")
    if not path.is_file():
        raise VolumeError(f"{path}: is a folder; name the file in it")
    if not str(path).lower().endswith(SUFFIXES):
        raise VolumeError(f"{path}: format {path.suffix!r} {HOW.format(name=path.name)}")


def _read(path: Path) -> Grid:
    """The grid of a file; an NRRD file is told by its first bytes whatever its name says."""
    if is_dicom(path):
        from .dicom.segmentation import read_segmentation

        return read_segmentation(path)
    from .nifti_files import opened, read_mgh, read_nifti
    from .nrrd_files import read_nrrd

    with opened(path) as file:
        start = file.read(4)
    if start == b"NRRD" or path.suffix.lower() in (".nrrd", ".nhdr"):
        return read_nrrd(path)
    return read_mgh(path) if path.suffix.lower() in (".mgz", ".mgh") else read_nifti(path)


def _unreadable(path: Path, error: BaseException) -> VolumeError:
    kind = "DICOM" if is_dicom(path) else KINDS.get(path.suffix.lower(), "NIfTI")
    reason = (str(error).splitlines() or [""])[0][:160].rstrip(".")
    if isinstance(error, EOFError | zlib.error) or "Expected" in reason or "mmap length" in reason:
        return VolumeError(f"{path}: the file is cut short or damaged ({reason}); copy or download it again")
    return VolumeError(
        f"{path}: cannot be read as {kind} ({type(error).__name__}: {reason}); export the label volume again"
    )

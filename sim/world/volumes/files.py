"""Reading label volumes: NIfTI by nibabel, NRRD with its header by pynrrd. Nothing is read before its size is known.

What a file claims is checked against memory and against the file's own size first, so that neither a damaged header
nor a decompression bomb can exhaust the machine.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import nrrd
import numpy as np
from nibabel import nifti1, nifti2
from nibabel.filebasedimages import ImageFileError
from nibabel.openers import Opener
from nibabel.spatialimages import HeaderDataError, HeaderTypeError, ImageDataError
from nibabel.wrapstruct import WrapStructError
from nrrd.reader import _determine_datatype
from numpy.typing import NDArray

from sim.world.errors import VolumeError

from .bounded_reading import read_payload
from .grid import Grid, check_affine, check_shape
from .label_values import read_labels
from .volume import Volume, shifted

SUFFIXES = (".nii", ".nii.gz", ".nrrd", ".nhdr")

METRES_PER_UNIT = {
    "mm": 1e-3,
    "millimeter": 1e-3,
    "millimeters": 1e-3,
    "meter": 1.0,
    "m": 1.0,
    "micron": 1e-6,
}

LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0])

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
        grid = _nifti(path) if str(path).lower().endswith((".nii", ".nii.gz")) else _nrrd(path)
    except READER_ERRORS as error:
        raise _unreadable(path, error) from error
    shape = check_shape(path, grid)
    T_lps_voxel = check_affine(path, grid, spacing_m)
    try:
        found = read_labels(
            path, grid.layers, shape, dtype=grid.dtype, slope=grid.slope, intercept=grid.intercept
        )
    except VolumeError:
        raise
    except READER_ERRORS as error:
        raise _unreadable(path, error) from error
    notices = [*grid.notices, *found.remarks]
    volume = Volume(
        labels=found.labels, T_lps_voxel=shifted(T_lps_voxel, found.box), box=found.box, scan_shape=shape,
        counts=found.counts, name=path.name, label_names=grid.label_names,
    )  # fmt: skip
    if volume.is_oblique:
        degrees = np.rad2deg(volume.obliquity_rad)
        notices.append(f"the scan is oblique by {degrees:.1f} degrees, which its axes take into account")
    object.__setattr__(volume, "notices", tuple(f"{path.name}: {notice}" for notice in notices))
    return volume


def _nifti(path: Path) -> Grid:
    image = nifti1.load(path) if _is_nifti1(path) else nifti2.load(path)
    header, stored = image.header, cast(Any, image.dataobj)  # its stubs know arrays alone
    unit = METRES_PER_UNIT.get(str(header.get_xyzt_units()[0]), 1e-3)
    T = np.eye(4)
    T[:3] = LPS_FROM_RAS @ np.asarray(image.affine, dtype=np.float64)[:3] * unit
    notices = []
    if not int(header["sform_code"]) and not int(header["qform_code"]):
        notices.append(
            "the header names no patient axes; its grid is taken for LAS, as NIfTI prescribes: "
            "check left and right"
        )
    slope, intercept = header.get_slope_inter()
    return Grid(
        shape=tuple(int(n) for n in image.shape),
        dtype=header.get_data_dtype(),
        T_lps_voxel=T,
        layers=lambda n: _nifti_layers(path, stored, n),
        is_streamed=True,
        slope=1.0 if slope is None else float(slope),
        intercept=0.0 if intercept is None else float(intercept),
        notices=notices,
        is_compressed=path.suffix.lower() == ".gz",
    )


def _nifti_layers(path: Path, stored: Any, n: int) -> Iterator[NDArray[Any]]:
    """Parts of a NIfTI file's voxels, none of which are kept."""
    i, j, n_layers = (*stored.shape[:2], int(np.prod(stored.shape[2:])))
    with Opener(str(path)) as file:
        file.seek(stored.offset)
        for first in range(0, n_layers, n):
            shape = (i, j, min(n, n_layers - first))
            n_bytes = int(np.prod(shape)) * stored.dtype.itemsize
            content = file.read(n_bytes)
            if len(content) < n_bytes:
                raise EOFError(
                    f"it ends {n_bytes - len(content):,} bytes before layer {first + shape[2]} does"
                )
            yield np.frombuffer(content, stored.dtype).reshape(shape, order="F")


def _parts(values: NDArray[Any], shape: tuple[int, ...], n: int) -> Iterator[NDArray[Any]]:
    """Parts of voxels that are in memory."""
    whole = values.reshape(tuple(size for axis, size in enumerate(shape) if axis < 3 or size != 1), order="F")
    for first in range(0, whole.shape[2], n):
        yield whole[:, :, first : first + n]


def _is_nifti1(path: Path) -> bool:
    """Whether the header has the size of NIfTI-1's, 348, rather than NIfTI-2's."""
    with Opener(str(path)) as file:
        start = file.read(4)
    if len(start) < 4:
        raise ValueError("the file ends within its header")
    sizes = {int.from_bytes(start, order) for order in ("little", "big")}
    if not sizes & {348, 540}:
        raise ValueError("the first bytes are not those of a NIfTI header")
    return 348 in sizes


def _nrrd(path: Path) -> Grid:
    with path.open("rb") as file:
        header = nrrd.read_header(file)
        start = file.tell()
    missing = [key for key in ("dimension", "type", "encoding", "sizes") if key not in header]
    if missing:
        raise ValueError(f"the header lacks {', '.join(missing)}")
    dtype = np.dtype(_determine_datatype(header))
    shape = tuple(int(n) for n in header["sizes"])
    if len(shape) != int(header["dimension"]):
        raise ValueError(f"{len(shape)} sizes are given for {header['dimension']} dimensions")
    T, notices = _nrrd_affine(header, len(shape))
    n_bytes = int(np.prod([max(n, 0) for n in shape], dtype=object)) * dtype.itemsize
    return Grid(
        shape=shape,
        dtype=dtype,
        T_lps_voxel=T,
        layers=lambda n: _parts(np.frombuffer(read_payload(path, header, start, n_bytes), dtype), shape, n),
        notices=notices,
        label_names=_segment_names(header),
        is_compressed=str(header["encoding"]).lower() not in ("raw",),
    )


def _nrrd_affine(header: dict[str, Any], n_axes: int) -> tuple[NDArray[np.float64], list[str]]:
    """Voxel indices to LPS metres, for the first three axes that lie in space."""
    notices: list[str] = []
    space = str(header.get("space", "")).lower().replace(" ", "-")
    known = {"left-posterior-superior": (1, 1, 1), "lps": (1, 1, 1), "right-anterior-superior": (-1, -1, 1)}
    known |= {"ras": (-1, -1, 1), "left-anterior-superior": (1, -1, 1), "las": (1, -1, 1)}
    if space not in known:
        notices.append(
            "the header names no patient axes that are known; LPS is assumed: check left and right"
        )
    flip = np.diag(np.array(known.get(space, (1, 1, 1)), dtype=np.float64))
    unit = METRES_PER_UNIT.get(str((header.get("space units") or ["mm"])[0]), 1e-3)
    T = np.eye(4)
    if header.get("space directions") is not None:
        rows = [row for row in header["space directions"] if row is not None and np.isfinite(row).all()]
        directions = np.array(rows, dtype=np.float64)
        if directions.shape != (3, 3):
            raise ValueError(f"{len(rows)} directions in space are given; three are needed")
        T[:3, :3] = flip @ directions.T * unit
    else:
        spacings = np.asarray(header.get("spacings", np.ones(n_axes)), dtype=np.float64)[:3]
        T[:3, :3] = flip @ np.diag(spacings) * unit
        if "spacings" not in header:
            notices.append(
                "the header gives no spacing; 1 mm is assumed: pass --spacing-mm X Y Z if it is not"
            )
    origin = np.asarray(header.get("space origin", np.zeros(3)), dtype=np.float64)
    T[:3, 3] = flip @ origin * unit
    return T, notices


def _segment_names(header: dict[str, Any]) -> dict[int, str]:
    """Names that 3D Slicer gives the labels in a .seg.nrrd."""
    names = {}
    for index in range(1000):
        name, value = header.get(f"Segment{index}_Name"), header.get(f"Segment{index}_LabelValue")
        if name is None:
            break
        if value is not None and str(value).isdecimal():
            names[int(value)] = str(name)
    return names


def _unreadable(path: Path, error: BaseException) -> VolumeError:
    kind = "NRRD" if path.suffix.lower() in (".nrrd", ".nhdr") else "NIfTI"
    reason = (str(error).splitlines() or [""])[0][:160].rstrip(".")
    if isinstance(error, EOFError | zlib.error) or "Expected" in reason or "mmap length" in reason:
        return VolumeError(f"{path}: the file is cut short or damaged ({reason}); copy or download it again")
    return VolumeError(
        f"{path}: cannot be read as {kind} ({type(error).__name__}: {reason}); export the label volume again"
    )

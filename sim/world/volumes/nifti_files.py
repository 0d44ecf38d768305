"""NIfTI files by nibabel: what the header claims, and the voxels part by part, none of which is kept."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
from nibabel import nifti1, nifti2
from nibabel.openers import Opener
from numpy.typing import NDArray

from .grid import METRES_PER_UNIT, Grid
from .label_names import extension_names
from .nifti_places import remarks_on_place

LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0])


def read_nifti(path: Path) -> Grid:
    """The grid of a .nii or .nii.gz file. No voxel is read before the grid's layers are taken.

    Raises:
        ValueError: The first bytes are not those of a NIfTI header. nibabel raises errors of its own on others.
    """
    image = nifti1.load(path) if _is_nifti1(path) else nifti2.load(path)
    # nibabel's stubs know a `dataobj` only as an array, which has no offset in the file.
    header, stored = image.header, cast(Any, image.dataobj)
    unit = METRES_PER_UNIT.get(str(header.get_xyzt_units()[0]), 1e-3)
    T = np.eye(4)
    T[:3] = LPS_FROM_RAS @ np.asarray(image.affine, dtype=np.float64)[:3] * unit
    # Once an image is loaded, its header forgets slope and intercept; the data object keeps them.
    slope, intercept = stored.slope, stored.inter
    return Grid(
        shape=tuple(int(n) for n in image.shape),
        dtype=header.get_data_dtype(),
        T_lps_voxel=T,
        layers=lambda n: _layers(path, stored, n),
        is_streamed=True,
        slope=1.0 if slope is None else float(slope),
        intercept=0.0 if intercept is None else float(intercept),
        notices=remarks_on_place(
            header, np.asarray(image.affine, dtype=np.float64), image.shape, unit_mm=unit * 1e3
        ),
        label_names=extension_names(each.content for each in header.extensions),
        is_compressed=path.suffix.lower() == ".gz",
    )


def _layers(path: Path, stored: Any, n: int) -> Iterator[NDArray[Any]]:
    """The voxels in parts of `n` layers, none of which is kept."""
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

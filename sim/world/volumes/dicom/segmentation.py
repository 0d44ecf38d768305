"""DICOM SEG: a segmentation as a label volume, its segments as labels with their names.

Frames are the slices of segments (PS3.3 A.51); those without a voxel are left out of the file. What is read of a frame
is where it lies, which segment it is of, and its pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import VolumeError
from sim.world.optional import optional_module

from ..grid import Grid
from ..nrrd_segments import Segment, SegmentLayers, layers_of
from .slices import Stack, stack_of

SEGMENTATION, LABEL_MAP = "1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7"
"""The UIDs of segmentations whose frames are of one segment each, and of those whose pixels are segments' numbers."""
MOST_FRAMES = 200_000


def is_segmentation(path: Path) -> bool:
    """Whether a DICOM file is a segmentation.

    Raises:
        MissingPackageError: pydicom is not installed.
        VolumeError: The file cannot be read.
    """
    pydicom = optional_module("pydicom", "dicom", f"{path}: DICOM")
    try:
        header = pydicom.dcmread(path, stop_before_pixels=True, specific_tags=["SOPClassUID"])
    except (pydicom.errors.InvalidDicomError, OSError, ValueError) as error:
        raise VolumeError(f"{path}: cannot be read as DICOM ({error}); export it again") from error
    return str(header.get("SOPClassUID", "")) in (SEGMENTATION, LABEL_MAP)


def read_segmentation(path: Path) -> Grid:
    """The grid of a DICOM SEG. No pixel is unpacked before the grid's layers are taken.

    Raises:
        ValueError: The file lacks what tells where its frames lie, or they are no stack.
    """
    pydicom = optional_module("pydicom", "dicom", f"{path}: DICOM")
    ds = pydicom.dcmread(path)
    frames = list(ds.PerFrameFunctionalGroupsSequence)
    if not 0 < len(frames) <= MOST_FRAMES:
        raise ValueError(f"it has {len(frames)} frames")
    shared = ds.SharedFunctionalGroupsSequence[0]
    measures = _group(shared, frames[0], "PixelMeasuresSequence")
    stack = stack_of(
        [_group(shared, each, "PlanePositionSequence").ImagePositionPatient for each in frames],
        [_group(shared, each, "PlaneOrientationSequence").ImageOrientationPatient for each in frames],
        measures.PixelSpacing,
        slice_spacing_mm=measures.get("SpacingBetweenSlices"),
        thickness_mm=measures.get("SliceThickness"),
    )
    is_label_map = str(ds.SOPClassUID) == LABEL_MAP
    segments = [
        Segment(name=str(each.get("SegmentLabel", "")), value=int(each.SegmentNumber), layer=i)
        for i, each in enumerate(ds.SegmentSequence)
        if int(each.SegmentNumber) > 0
    ]
    numbers = [
        0
        if is_label_map
        else int(_group(shared, each, "SegmentIdentificationSequence").ReferencedSegmentNumber)
        for each in frames
    ]
    layers = layers_of(segments, len(segments))
    return Grid(
        shape=(int(ds.Columns), int(ds.Rows), stack.n_slices),
        dtype=np.dtype(np.uint16),
        T_lps_voxel=stack.T_lps_voxel,
        layers=lambda n: _layers(ds, stack, numbers, segments, layers, n),
        label_names={each.value: each.name for each in segments if each.name},
        overlaps=layers.overlaps,
        is_compressed=True,  # empty slices are left out, and voxels may be bits
    )


def _group(shared: Any, frame: Any, name: str) -> Any:
    """The functional group of a frame, which all may share.

    Raises:
        ValueError: There is none.
    """
    for owner in (frame, shared):
        if name in owner and len(owner[name].value):
            return owner[name].value[0]
    raise ValueError(f"its frames have no {name}")


def _layers(
    ds: Any,
    stack: Stack,
    numbers: list[int],
    segments: list[Segment],
    layers: SegmentLayers,
    thickness: int,
) -> Iterator[NDArray[np.uint16]]:
    """The labels of the voxels in parts of so many slices; shape (columns, rows, n)."""
    pixels = np.asarray(ds.pixel_array)
    pixels = pixels[None] if pixels.ndim == 2 else pixels
    # A share of a voxel counts from one half on.
    least = int(ds.get("MaximumFractionalValue", 1)) / 2.0
    is_fractional = str(ds.get("SegmentationType", "")) == "FRACTIONAL"
    row_of = {each.value: i for i, each in enumerate(segments)}
    for first in range(0, stack.n_slices, thickness):
        n = min(thickness, stack.n_slices - first)
        if numbers[0] == 0:
            whole = np.zeros((n, *pixels.shape[1:]), dtype=np.uint16)
            for frame, index in enumerate(stack.indices):
                if first <= index < first + n:
                    whole[index - first] = pixels[frame]
            yield whole.transpose(2, 1, 0)
            continue
        parts = np.zeros((len(segments), n, *pixels.shape[1:]), dtype=np.uint16)
        for frame, (index, number) in enumerate(zip(stack.indices, numbers, strict=True)):
            if first <= index < first + n and number in row_of:
                is_in = pixels[frame] >= least if is_fractional else pixels[frame] > 0
                parts[row_of[number], index - first][is_in] = number
        yield layers.combined(parts).transpose(2, 1, 0)

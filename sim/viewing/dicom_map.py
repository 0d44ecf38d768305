"""The map as DICOM on the slices of the series that it lies in: a SEG of its labels, a parametric map of its values."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import UsageError
from sim.record.map_volumes import UNSEEABLE, MapArrays
from sim.record.scan_maps import STEP, ScanGrid, map_on_grid
from sim.world.optional import optional_module
from sim.world.solids.solid import Solid
from sim.world.volumes.dicom.slices import stack_of_files

from .segment_nrrd import ORGAN_LABEL, segments_of_map

NAME, MOST_SLICES = "Sounding", 5000
DEMANDED = ("StudyInstanceUID", "FrameOfReferenceUID", "SOPInstanceUID", "SOPClassUID")
"""What a slice must tell, so that what is made of it lies beside it."""
MAY_BE_EMPTY = (
    "PatientID", "PatientName", "PatientBirthDate", "PatientSex", "StudyID", "StudyDate", "StudyTime",
    "AccessionNumber", "ReferringPhysicianName",
)  # fmt: skip
"""What DICOM lets be empty (type 2), and programs that take names out of series often leave out."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """The slices of a series, in the order in which they lie."""

    slices: tuple[Any, ...]
    """Datasets with their pixels."""
    grid: ScanGrid
    """Their voxels: columns, rows, slices."""


def highdicom() -> ModuleType:
    """The module highdicom.

    Raises:
        MissingPackageError: It is not installed.
    """
    return optional_module("highdicom", "dicom", "DICOM")


def read_series(folder: Path) -> Series:
    """The one series that a folder holds; what is no picture of a series is passed over.

    Raises:
        MissingPackageError: pydicom is not installed.
        UsageError: There is none, there are several, or its slices are no stack.
    """
    pydicom = optional_module("pydicom", "dicom", "DICOM")
    found = []
    for file in sorted(folder.iterdir())[:MOST_SLICES] if folder.is_dir() else ():
        try:
            ds = pydicom.dcmread(file)
        except (pydicom.errors.InvalidDicomError, OSError, ValueError):
            continue
        if "ImagePositionPatient" in ds and "PixelData" in ds and "PixelSpacing" in ds:
            found.append(ds)
    series = {str(each.SeriesInstanceUID) for each in found}
    if len(series) != 1:
        raise UsageError(
            f"{folder}: holds {len(series)} series of slices. Name the folder of one series, as `series`."
        )
    try:
        stack = stack_of_files(found)
    except (ValueError, AttributeError) as error:
        raise UsageError(f"{folder}: {error}. Name the folder of a series of parallel slices.") from error
    if len(set(stack.indices.tolist())) != len(found) or stack.n_slices != len(found):
        raise UsageError(f"{folder}: slices are missing, or there are several at one place.")
    for ds in found:
        _complete(ds)
    ordered = tuple(found[i] for i in np.argsort(stack.indices))
    shape = (int(found[0].Columns), int(found[0].Rows), len(found))
    return Series(slices=ordered, grid=ScanGrid(shape=shape, T_lps_voxel=stack.T_lps_voxel))


def _complete(ds: Any) -> None:
    """Put in what a slice may leave empty, so that objects can be made from it.

    Raises:
        UsageError: It lacks more than that.
    """
    if missing := [name for name in DEMANDED if not ds.get(name)]:
        raise UsageError(
            f"{ds.filename}: lacks {', '.join(missing)}, so that no map can refer to it. Export the series anew from "
            "where it is kept."
        )
    for name in MAY_BE_EMPTY:
        if name not in ds:
            setattr(ds, name, "")


def dicom_map(
    arrays: MapArrays, organ: Solid, T_world_organ: NDArray[np.float64], series: Series, *, threshold: float
) -> dict[str, bytes]:
    """The DICOM files of a map by name, with their contents; their identifiers follow from map and slices.

    Args:
        arrays: The map.
        organ: The organ's surface, world frame [m].
        T_world_organ: Maps patient axes (LPS) [m] to the world, shape (4, 4).
        series: The series on whose slices the map is laid; both have the organ's own frame.
        threshold: Probability above which a voxel is labelled as what is mapped.

    Raises:
        UsageError: The organ lies beside the series.
    """
    probability, labels = map_on_grid(arrays, organ, T_world_organ, series.grid, threshold=threshold)
    used = np.flatnonzero(labels.any(axis=(0, 1)))
    if not used.size:
        raise UsageError(
            "the organ lies in no slice of the series. Name the series that the organ was segmented on."
        )
    part = slice(int(used[0]), int(used[-1]) + 1)
    sources = list(series.slices[part])
    stem = arrays.of.file_stem
    in_rows = [np.ascontiguousarray(each[:, :, part].transpose(2, 1, 0)) for each in (labels, probability)]
    try:
        return {
            f"{stem}_segmentation.dcm": _bytes(_segmentation(arrays, in_rows[0], sources)),
            f"{stem}_probability.dcm": _bytes(_parametric_map(arrays, in_rows[1], sources)),
        }
    except (AttributeError, TypeError, ValueError) as error:
        # highdicom's words for a series that lacks what an object of it needs.
        raise UsageError(
            f"{Path(sources[0].filename).parent}: no map can refer to this series ({type(error).__name__}: {error}). "
            "Export it anew from where it is kept."
        ) from error


def _segmentation(arrays: MapArrays, labels: NDArray[np.uint8], sources: list[Any]) -> Any:
    """A SEG whose segments are the whole organ, what is mapped, and what lies in no cone."""
    hd, codes = highdicom(), optional_module("pydicom.sr.codedict", "dicom", "DICOM").codes
    kinds = {
        ORGAN_LABEL: (codes.SCT.AnatomicalStructure, codes.SCT.Organ),
        arrays.of.label: (codes.SCT.MorphologicallyAbnormalStructure, codes.SCT.Neoplasm),
        UNSEEABLE: (codes.SCT.SpatialAndRelationalConcept, codes.SCT.Organ),
    }
    segments = segments_of_map(arrays)
    masks = [labels > 0 if each.label == ORGAN_LABEL else labels == each.label for each in segments]
    kept = [i for i, mask in enumerate(masks) if mask.any()]
    algorithm = hd.AlgorithmIdentificationSequence(
        name=NAME, version=metadata.version("sounding"), family=codes.DCM.ArtificialIntelligence
    )
    descriptions = [
        hd.seg.SegmentDescription(
            segment_number=number,
            segment_label=segments[i].name,
            segmented_property_category=kinds[segments[i].label][0],
            segmented_property_type=kinds[segments[i].label][1],
            algorithm_type=hd.seg.SegmentAlgorithmTypeValues.AUTOMATIC,
            algorithm_identification=algorithm,
            display_color=hd.color.CIELabColor.from_string(segments[i].colour),
        )
        for number, i in enumerate(kept, start=1)
    ]
    return hd.seg.Segmentation(
        source_images=sources,
        pixel_array=np.stack([masks[i] for i in kept], axis=-1).astype(np.uint8),
        segmentation_type=hd.seg.SegmentationTypeValues.BINARY,
        segment_descriptions=descriptions,
        content_description=f"Map of {arrays.of.noun}"[:64],
        **_identity(labels, sources, "segmentation", 901),
    )


def _parametric_map(arrays: MapArrays, probability: NDArray[np.uint8], sources: list[Any]) -> Any:
    """A parametric map in a byte a voxel, whose real-world value is the probability."""
    hd, codes = highdicom(), optional_module("pydicom.sr.codedict", "dicom", "DICOM").codes
    most = round(1.0 / STEP)
    mapping = hd.pm.RealWorldValueMapping(
        lut_label="probability",
        lut_explanation=f"probability of {arrays.of.noun}"[:64],
        unit=codes.UCUM.NoUnits,
        value_range=(0, most),
        slope=STEP,
        intercept=0.0,
    )
    return hd.pm.ParametricMap(
        source_images=sources,
        pixel_array=probability,
        contains_recognizable_visual_features=False,
        real_world_value_mappings=[mapping],
        voi_lut_transformations=[hd.VOILUTTransformation(window_center=most / 2, window_width=most)],
        content_description=f"Map of {arrays.of.noun}"[:64],
        **_identity(probability, sources, "probability", 902),
    )


def _identity(values: NDArray[np.uint8], sources: list[Any], what: str, number: int) -> dict[str, Any]:
    """Who made an object, and identifiers that follow from its values and from the slices on which they lie."""
    generate_uid = optional_module("pydicom.uid", "dicom", "DICOM").generate_uid
    names = ("StudyInstanceUID", "SeriesInstanceUID", "FrameOfReferenceUID", "SOPInstanceUID")
    lies_on = "\n".join(str(each.get(name)) for each in sources for name in names)
    digest = hashlib.sha256(f"{values.shape}\n{lies_on}\n".encode() + values.tobytes()).hexdigest()
    version = metadata.version("sounding")
    return {
        "series_instance_uid": generate_uid(entropy_srcs=[what, "series", digest]),
        "sop_instance_uid": generate_uid(entropy_srcs=[what, "instance", digest]),
        "series_number": number,
        "instance_number": 1,
        "manufacturer": NAME,
        "manufacturer_model_name": NAME,
        "software_versions": version,
        "device_serial_number": version,
    }


def _bytes(dataset: Any) -> bytes:
    buffer = io.BytesIO()
    dataset.save_as(buffer)
    return buffer.getvalue()

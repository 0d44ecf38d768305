"""A run's map over the patient's scan: NIfTI on its own grid and on the scan's, Slicer's segmentation, and DICOM."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapping.storage import replacing
from sim.notices import Notify, print_notice
from sim.record.map_volumes import THRESHOLD, MapArrays, map_volumes, read_maps
from sim.record.scan_maps import scan_grid_of, scan_map_volumes
from sim.record.trajectories import read_anatomy
from sim.world.errors import WorldError

from .dicom_map import dicom_map, read_series
from .segment_nrrd import segment_nrrd

Format = Literal["nifti", "seg-nrrd", "dicom"]
"""Volumes, 3D Slicer's segmentation, or DICOM SEG and parametric map."""


def export_map(
    folder: Path,
    out: Path | None = None,
    *,
    threshold: float = THRESHOLD,
    formats: Collection[Format] = ("nifti",),
    series: Path | None = None,
    notify: Notify = print_notice,
) -> list[Path]:
    """Write a run's map, and return the files.

    Where the organ came from a label volume, NIfTI is written on that volume's grid too.

    Args:
        folder: The run's folder.
        out: Folder to write to; by default that of the run.
        threshold: Probability above which a point is labelled tumour, between 0 and 1.
        formats: What to write.
        series: Folder of the DICOM series that the organ was segmented on, on whose slices DICOM is laid.
        notify: Tells a notice; by default on stderr.

    Raises:
        UsageError: The folder holds no map that can be read, or the series cannot be used.
        MissingPackageError: DICOM is wanted, and its packages are not installed.
    """
    maps, T_world_organ = read_maps(folder)
    contents = []
    if "nifti" in formats:
        contents += [map_volumes(arrays, T_world_organ, threshold=threshold) for arrays in maps]
        contents += _on_scan(folder, maps, T_world_organ, threshold, notify)
    if "seg-nrrd" in formats:
        contents += [
            {f"{arrays.of.file_stem}.seg.nrrd": segment_nrrd(arrays, T_world_organ, threshold=threshold)}
            for arrays in maps
        ]
    if "dicom" in formats:
        slices, organ = read_series(series or folder), read_anatomy(folder).organ
        contents += [dicom_map(arrays, organ, T_world_organ, slices, threshold=threshold) for arrays in maps]
    out = out or folder
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for files in contents:
        for name, content in files.items():
            with replacing(out / name) as file:
                file.write(content)
            written.append(out / name)
    return written


def _on_scan(
    folder: Path,
    maps: list[MapArrays],
    T_world_organ: NDArray[np.float64],
    threshold: float,
    notify: Notify,
) -> Iterator[dict[str, bytes]]:
    """The files on the scan's grid; none where the organ came from no volume, or the volume is gone."""
    config = json.loads((folder / "config.json").read_text(encoding="utf-8-sig"))
    try:
        grid = scan_grid_of(config)
    except WorldError as error:
        notify(f"the map is written on its own grid alone, since the scan's cannot be had: {error}")
        return
    if grid is not None:
        organ = read_anatomy(folder).organ
        for arrays in maps:
            yield scan_map_volumes(arrays, organ, T_world_organ, grid, threshold=threshold)

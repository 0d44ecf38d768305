"""`sounding export`: a run's map over the patient's scan, as NIfTI, for 3D Slicer, or as DICOM."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from sim.errors import FieldError, UsageError

from .terminal import note, parse

EXAMPLES = """
sounding export renders/first --out for_slicer
sounding export renders/first --threshold 0.9 --out for_slicer
sounding export renders/first --format seg-nrrd --out for_slicer
sounding export renders/first --format dicom --series ct --out for_pacs
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Write a run's map in the patient's own coordinates, so that it lies over the scan: by default as NIfTI volumes.

    Every run with a map writes them; this command writes them again, to another folder or with another threshold. The
    files are map_probability.nii.gz, map_standard_deviation.nii.gz (of the map's latent) and map_labels.nii.gz (where 1
    is the organ, 2 tumour, and 4 organ that lies in no pose's cone). The map of a second class goes to
    map_target_*.nii.gz, where its label is 3. Where the organ came from a label volume, map_on_scan_*.nii.gz hold
    probability and labels on the grid of that volume, voxel by voxel. As DICOM (extra `dicom`) the map lies on the
    slices of a series: map_segmentation.dcm is a SEG, map_probability.dcm a parametric map.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of a run of `sounding episode`."""
    threshold: float = 0.5
    """Probability above which a point is labelled tumour, between 0 and 1."""
    format: tuple[Literal["nifti", "seg-nrrd", "dicom"], ...] = ("nifti",)
    """What to write: nifti, seg-nrrd (3D Slicer's segmentation, with names and colours), dicom, or several of them."""
    series: Path | None = None
    """Folder of the DICOM series that the organ was segmented on, which dicom needs."""
    out: Path | None = None
    """Folder to write to; by default that of the run."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 0.0 < self.threshold < 1.0:
            raise FieldError("threshold", self.threshold, "must be between 0 and 1, both excluded.")
        if self.out is not None and self.out.exists() and not self.out.is_dir():
            raise UsageError(f"{self.out}: is a file, not a folder. Choose another `out`.")
        if ("dicom" in self.format) != (self.series is not None):
            raise UsageError("`format` dicom needs the folder of a `series`, and nothing but it does.")


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Write the volumes, and return the exit code."""
    from sim.viewing.export import export_map

    files = export_map(
        options.folder,
        options.out,
        threshold=options.threshold,
        formats=options.format,
        series=options.series,
        notify=note,
    )
    for file in files:
        print(f"written {file}")
    return 0

"""What can be asked about a patient's files and a run's map: pure data, in the units people type."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sim.episode.scenario import CodingName, MeshFrame, Unit
from sim.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class InspectOptions:
    """Say what a mesh or a label volume holds, draw it, and say what is wrong with it and what to do.

    Prints labels, volumes, spacing, orientation, islands, and tumours with diameters and depths. The exit code is 0
    where the file can be used as the organ with the options given, else 1.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """STL, OBJ, PLY, GLB or glTF mesh, or label volume (.nii, .nii.gz, .nrrd, .nhdr)."""
    tumour: tuple[Path, ...] = ()
    """Meshes or label volumes of tumours in the same coordinates."""
    unit: Unit = "mm"
    """Unit of mesh files."""
    mesh_frame: MeshFrame = "auto"
    """Axes of mesh files: lps, ras, or auto for what the file's header says, else lps."""
    coding: CodingName = "auto"
    """What the numbers of a label volume mean: lits, msd-liver, 3d-ircadb, totalsegmentator, or auto."""
    organ_label: tuple[int, ...] = ()
    """Labels of the organ, in place of the coding's."""
    tumour_label: tuple[int, ...] = ()
    """Labels of tumours, in place of the coding's."""
    target: tuple[Path, ...] = ()
    """Meshes or label volumes of a second class that is to be mapped beside the tumours."""
    target_label: tuple[int, ...] = ()
    """Labels of that class."""
    structure: tuple[Path, ...] = ()
    """Meshes or masks of vessels and other structures."""
    structure_label: tuple[int, ...] = ()
    """Labels of such structures."""
    keepout: tuple[Path, ...] = ()
    """Meshes or masks of structures that must not be pressed."""
    keepout_label: tuple[int, ...] = ()
    """Labels of such structures."""
    spacing_mm: tuple[float, float, float] | None = None
    """Distances between voxels [mm] in place of the header's."""
    out: Path | None = None
    """PNG to draw; renders/inspect-<name>.png by default."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if self.spacing_mm is not None and not all(0.02 <= each <= 30.0 for each in self.spacing_mm):
            raise UsageError(f"--spacing-mm {' '.join(map(str, self.spacing_mm))}: from 0.02 to 30 mm.")
        if self.out is not None and self.out.suffix.lower() != ".png":
            raise UsageError(f"--out {self.out}: must end with .png.")

    @property
    def picture(self) -> Path:
        """The PNG to draw."""
        return self.out or Path("renders") / f"inspect-{self.file.name.split('.')[0]}.png"


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Write a run's map as NIfTI volumes in the patient's own coordinates, to lie over the scan.

    Every run with a map writes them; this writes them again, elsewhere or with another threshold. The files are
    map_probability.nii.gz, map_standard_deviation.nii.gz (of the map's latent) and map_labels.nii.gz (1 organ,
    2 tumour). The map of a second class goes to map_target_*.nii.gz, labelled 3.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of a run of `sounding episode`."""
    threshold: float = 0.5
    """Probability above which a point is labelled tumour, between 0 and 1."""
    out: Path | None = None
    """Folder to write to; the run's own by default."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 0.0 < self.threshold < 1.0:
            raise UsageError(f"--threshold {self.threshold}: between 0 and 1, both excluded.")
        if self.out is not None and self.out.exists() and not self.out.is_dir():
            raise UsageError(f"{self.out}: is a file, not a folder. Choose another --out.")

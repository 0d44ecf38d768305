"""A patient's case as plain data: its files, and how the organ lies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.episode.scenario import LIVER
from sim.errors import FieldError, UsageError
from sim.world.anatomy.case_files import CaseFiles
from sim.world.meshes.coordinates import MeshFrame, Unit
from sim.world.volumes.label_coding import CodingName, LabelChoice

MOST_MM = 3000.0
"""No organ stands farther from the arm's base than this."""
MM = 1e-3
"""A millimetre [m]."""
PATIENT_FIELDS = (
    *("organ_object", "tumour", "organ_label", "tumour_label", "target", "target_label"),
    *("structure", "structure_label", "keepout", "keepout_label", "spacing_mm"),
    "voxel_axes",
)
"""Fields that mean nothing without a patient's own organ."""


@dataclass(frozen=True, kw_only=True)
class CaseConfig:
    """A patient's files besides the organ's, and how to read them."""

    organ_object: str | None = None
    """Name of the object in the organ's file that is the organ, where the file holds several; or piece 2 for the second
    largest of its separate pieces."""
    tumour: tuple[Path, ...] = ()
    """Meshes or label volumes of true tumours in the organ's coordinates, besides those in the organ's own volume."""
    unit: Unit = "mm"
    """Unit of mesh files."""
    mesh_frame: MeshFrame = "auto"
    """Axes of mesh files: lps, ras, or auto, which takes what the file's header says, and LPS where it says nothing."""
    coding: CodingName = "auto"
    """Meaning of the numbers in a label volume: lits, msd-liver, 3d-ircadb, totalsegmentator, or auto, which tells it
    from the labels."""
    organ_label: tuple[int, ...] = ()
    """Labels of the organ, in place of those of `coding`; the tumours are added to the organ."""
    tumour_label: tuple[int, ...] = ()
    """Labels of tumours, in place of those of `coding`."""
    target: tuple[Path, ...] = ()
    """Meshes or label volumes of a second class, such as cysts, which is mapped beside the tumours."""
    target_label: tuple[int, ...] = ()
    """Labels of the second class."""
    structure: tuple[Path, ...] = ()
    """Meshes or masks of vessels and other structures, which are shown, and to which distances are measured."""
    structure_label: tuple[int, ...] = ()
    """Labels of vessels and other structures."""
    keepout: tuple[Path, ...] = ()
    """Meshes or masks of structures near which the probe must not press."""
    keepout_label: tuple[int, ...] = ()
    """Labels of structures near which the probe must not press."""
    spacing_mm: tuple[float, float, float] | None = None
    """Distances between the voxels of a label volume [mm], in place of those in its header where these are wrong."""
    voxel_axes: str | None = None
    """Where the axes of the volume run, such as LPS or RAS, in place of what its header says where that is wrong."""

    def check(self, organ: Path | None) -> None:
        """Check that the fields go with the organ's file, which is None for the scenario's own organ.

        Raises:
            UsageError: A field tells about the file of an organ, and none is given.
        """
        for name in PATIENT_FIELDS:
            if getattr(self, name) and organ is None:
                raise UsageError(f"`{name}` goes with `organ`, the file of the patient that it tells about.")

    def files(self, organ: Path) -> CaseFiles:
        """The files of the patient with that of the organ, and how to read them."""
        return CaseFiles(
            organ=str(organ),
            organ_object=self.organ_object,
            tumours=_texts(self.tumour),
            targets=_texts(self.target),
            structures=_texts(self.structure),
            keepouts=_texts(self.keepout),
            unit=self.unit,
            frame=self.mesh_frame,
            labels=LabelChoice(
                coding=self.coding,
                organ=self.organ_label,
                tumours=self.tumour_label,
                targets=self.target_label,
                structures=self.structure_label,
                keepouts=self.keepout_label,
            ),
            spacing_m=None if self.spacing_mm is None else metres(self.spacing_mm),
            voxel_axes=self.voxel_axes,
        )


@dataclass(frozen=True, kw_only=True)
class AnatomyConfig:
    """What is planted in the organ, how the organ lies, and how near to a structure the probe may press."""

    n_tumours: int | None = None
    """Number of tumours to plant where no file holds any; by default that of the scenario, or 0 with your own organ."""
    target_name: str | None = None
    """Name of the second class; target by default."""
    keepout_mm: float | None = None
    """Least distance of the sensing poses from structures near which the probe must not press [mm]; by default that of
    the scenario, 5."""
    organ_pose: tuple[str, ...] = ()
    """How the organ lies: anterior-up (on the table, the default), best (the way up in which the cones of poses within
    the arm's reach see most of it), three angles by which it is turned from anterior up about the world's x, y and z
    [degrees], or seven numbers, the position [mm] and the quaternion (wxyz) of the files' LPS axes in the world."""


def scenario_changes(organ: Path | None, case: CaseConfig, anatomy: AnatomyConfig) -> dict[str, Any]:
    """The fields of a `Scenario` that a case changes.

    Args:
        organ: The organ's file; None for the scenario's own organ.
        case: The patient's other files.
        anatomy: What is planted, and how the organ lies.

    Raises:
        UsageError: The organ's pose is none, or fields do not go together.
    """
    case.check(organ)
    changes: dict[str, Any] = pose_changes(anatomy.organ_pose)
    if anatomy.n_tumours is not None:
        changes |= {"n_tumours": anatomy.n_tumours, "tumour_load": "fixed"}
    if organ is not None:
        changes |= {
            "name": organ.name.split(".")[0],
            "organ": LIVER,
            "files": case.files(organ),
            "n_tumours": anatomy.n_tumours or 0,
            "tumour_load": "fixed",
        }
    if anatomy.keepout_mm is not None:
        changes["keepout_distance_m"] = anatomy.keepout_mm * MM
    if anatomy.target_name is not None:
        changes["target_name"] = anatomy.target_name
    return changes


def pose_changes(words: tuple[str, ...]) -> dict[str, Any]:
    """The fields of a `Scenario` that say how the organ lies.

    Args:
        words: Nothing, `anterior-up`, `best`, three angles [degrees], or a position [mm] and a quaternion (wxyz).

    Raises:
        FieldError: The words are none of these.
    """
    if not words or words == ("anterior-up",):
        return {}
    if words == ("best",):
        return {"organ_placing": "best"}
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) == 3 and all(abs(each) <= 360.0 for each in numbers):
        return {"organ_turn_rad": tuple(math.radians(each) for each in numbers)}
    is_pose = len(numbers) == 7 and all(abs(each) <= MOST_MM for each in numbers[:3])
    if is_pose and 0.0 < math.hypot(*numbers[3:]) < math.inf:
        return {
            "organ_position_m": tuple(each * MM for each in numbers[:3]),
            "organ_quaternion": tuple(numbers[3:]),
        }
    raise FieldError(
        "organ_pose",
        words,
        "must be anterior-up, best, three angles [degrees] up to 360, or seven numbers: X Y Z [mm] and QW QX QY QZ, "
        "not all zero.",
    )


def metres(lengths_mm: tuple[float, float, float]) -> tuple[float, float, float]:
    """Three lengths in metres."""
    x_mm, y_mm, z_mm = lengths_mm
    return x_mm * MM, y_mm * MM, z_mm * MM


def _texts(files: tuple[Path, ...]) -> tuple[str, ...]:
    return tuple(str(file) for file in files)

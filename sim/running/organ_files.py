"""The files of a patient, as the command line names them, in a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .options import EpisodeOptions


def organ_changes(options: EpisodeOptions, organ: Path) -> dict[str, Any]:
    """Fields of the scenario that the files of a patient replace.

    Args:
        options: What the command line says of them.
        organ: The organ's file.
    """
    spacing = options.spacing_mm
    return {
        "name": organ.name.split(".")[0],
        "organ": str(organ),
        "organ_unit": options.unit,
        "organ_frame": options.mesh_frame,
        "tumour_files": _texts(options.tumour),
        "target_files": _texts(options.target),
        "structure_files": _texts(options.structure),
        "keepout_files": _texts(options.keepout),
        "keepout_distance_m": options.keepout_mm * 1e-3,
        "label_coding": options.coding,
        "organ_labels": options.organ_label,
        "tumour_labels": options.tumour_label,
        "target_labels": options.target_label,
        "structure_labels": options.structure_label,
        "keepout_labels": options.keepout_label,
        "voxel_spacing_m": None if spacing is None else tuple(each * 1e-3 for each in spacing),
        "n_tumours": options.n_tumours or 0,
        "tumour_load": "fixed",
    }


def _texts(files: tuple[Path, ...]) -> tuple[str, ...]:
    return tuple(str(file) for file in files)

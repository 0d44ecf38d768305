"""A run's map as NIfTI volumes over the patient's scan."""

from __future__ import annotations

from pathlib import Path

from mapping.storage import replacing
from sim.record.map_volumes import THRESHOLD, map_volumes, read_maps


def export_map(folder: Path, out: Path | None = None, *, threshold: float = THRESHOLD) -> list[Path]:
    """Write the volumes of a run's map, and return the files.

    Args:
        folder: The run's folder.
        out: Folder to write to; by default that of the run.
        threshold: Probability above which a point is labelled tumour, between 0 and 1.

    Raises:
        UsageError: The folder holds no map that can be read.
    """
    maps, T_world_organ = read_maps(folder)
    out = out or folder
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for arrays in maps:
        for name, content in map_volumes(arrays, T_world_organ, threshold=threshold).items():
            with replacing(out / name) as file:
                file.write(content)
            written.append(out / name)
    return written

"""A run's map as NIfTI volumes over the patient's scan, on the map's own grid and on the scan's."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.storage import replacing
from sim.notices import Notify, print_notice
from sim.record.map_volumes import THRESHOLD, MapArrays, map_volumes, read_maps
from sim.record.scan_maps import scan_grid_of, scan_map_volumes
from sim.record.trajectories import read_anatomy
from sim.world.errors import WorldError


def export_map(
    folder: Path, out: Path | None = None, *, threshold: float = THRESHOLD, notify: Notify = print_notice
) -> list[Path]:
    """Write the volumes of a run's map, and return the files.

    Where the organ came from a label volume, the map is written on that volume's grid too.

    Args:
        folder: The run's folder.
        out: Folder to write to; by default that of the run.
        threshold: Probability above which a point is labelled tumour, between 0 and 1.
        notify: Tells a notice; by default on stderr.

    Raises:
        UsageError: The folder holds no map that can be read.
    """
    maps, T_world_organ = read_maps(folder)
    out = out or folder
    out.mkdir(parents=True, exist_ok=True)
    contents = [map_volumes(arrays, T_world_organ, threshold=threshold) for arrays in maps]
    written = []
    for files in (*contents, *_on_scan(folder, maps, T_world_organ, threshold, notify)):
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

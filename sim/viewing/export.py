"""The program behind `sounding export`: a run's map as NIfTI volumes over the patient's scan."""

from __future__ import annotations

from mapping.storage import replacing
from sim.cli.patient_options import ExportOptions
from sim.record.map_volumes import map_volumes, read_maps


def run_export(options: ExportOptions) -> str:
    """Write the volumes; returns a text that says where they are.

    Raises:
        UsageError: The folder holds no map that can be read.
    """
    maps, T_world_organ = read_maps(options.folder)
    out = options.out or options.folder
    out.mkdir(parents=True, exist_ok=True)
    lines = []
    for arrays in maps:
        for name, content in map_volumes(arrays, T_world_organ, threshold=options.threshold).items():
            with replacing(out / name) as file:
                file.write(content)
            lines.append(f"written {out / name}")
    return "\n".join(lines)

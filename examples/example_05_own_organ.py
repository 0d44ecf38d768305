"""An organ of one's own, made of arrays, with a tumour in it: surfaces in metres and in patient axes (LPS)."""

import json
from pathlib import Path

import numpy as np
import trimesh

import sounding


def ellipsoid(
    half_axes_m: tuple[float, float, float], centre_m: tuple[float, float, float]
) -> trimesh.Trimesh:
    """A closed surface from vertices, shape (N, 3), and faces, shape (M, 3): +x left, +y back, +z head."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    return trimesh.Trimesh(ball.vertices * np.array(half_axes_m) + np.array(centre_m), ball.faces)


def main() -> None:
    organ = ellipsoid((0.08, 0.045, 0.06), (0.0, 0.0, 0.0))
    tumour = ellipsoid((0.012, 0.008, 0.008), (-0.03, 0.0, 0.02))
    # One record holds all that belongs to a patient; paths of files may stand in place of surfaces.
    files = sounding.CaseFiles(organ=organ, tumours=(tumour,))
    summary = sounding.run_episode(
        scenario=sounding.Scenario(name="ellipsoid", files=files, n_poses=500),
        steps=12,
        out="renders/own-organ",
        overwrite=True,
        show_progress=False,
    )
    (found,) = json.loads((Path(summary["folder"]) / "findings.json").read_text())["tumours"]
    print(f"poses out of reach     {summary['n_skipped_poses']:>8}")
    print(f"tumour sensed          {summary['sensed_fraction']:>8.0%}")
    print(f"true volume            {tumour.volume * 1e6:>8.2f} ml")
    print(f"mapped volume          {found['mapped_volume_m3'] * 1e6:>8.2f} ml")
    print(f"error of its centre    {found['centroid_error_m'] * 1e3:>8.2f} mm")


if __name__ == "__main__":
    main()

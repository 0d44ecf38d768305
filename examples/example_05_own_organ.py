"""An organ of one's own, made of arrays: vertices and faces in metres, in patient axes (LPS)."""

import numpy as np
import trimesh

import sounding


def main() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    vertices_m = ball.vertices * np.array([0.08, 0.06, 0.045])  # an ellipsoid: +x left, +y back, +z head
    organ = trimesh.Trimesh(vertices_m, ball.faces)
    scenario = sounding.Scenario(name="ellipsoid", organ=organ, n_tumours=2, n_poses=500)
    summary = sounding.run_episode(
        scenario=scenario, steps=10, seed=4, out="renders/own-organ", overwrite=True, show_progress=False
    )  # fmt: skip
    print(f"poses out of reach     {summary['n_skipped_poses']}")
    print(f"tumours sensed         {summary['sensed_fraction']:.0%}")
    print(f"AUPRC of the map       {summary['auprc']:.3f}")

    # A patient's files instead, with everything that belongs to them in one record:
    files = sounding.CaseFiles(
        organ="liver.stl", tumours=("tumour.stl",), structures=("veins.stl",), unit="mm"
    )
    print(f"files of a patient     {', '.join(files.paths)}")


if __name__ == "__main__":
    main()

"""Surfaces for other programs: where they lie, in which unit, and that they close."""

from __future__ import annotations

import numpy as np
import trimesh
from planted_run import planted_run

from sim.findings.results import findings_of
from sim.findings.surface_files import write_surfaces

R = 0.012


def test_stl_lies_in_the_organs_file_in_millimetres_and_gltf_in_metres(tmp_path) -> None:
    centre_m = np.array([0.02, 0.01, -0.03])
    record = planted_run(
        tmp_path, true=[(tuple(centre_m), R)], mapped=[(tuple(centre_m), R), ((-0.04, 0.0, 0.0), 0.01)]
    )
    files = write_surfaces(record, findings_of(record))
    names = ["mapped_false_1.stl", "mapped_tumour_1.stl", "mapped.glb"]
    assert sorted(file.name for file in files) == sorted(names)
    in_organ_m = (np.linalg.inv(record.T_world_organ) @ [*centre_m, 1.0])[:3]
    mesh = trimesh.load(tmp_path / "surfaces" / "mapped_tumour_1.stl")
    assert mesh.is_watertight
    assert mesh.volume > 0  # outward
    np.testing.assert_allclose(mesh.center_mass, in_organ_m * 1e3, atol=0.3)
    np.testing.assert_allclose(mesh.volume, 4 / 3 * np.pi * (R * 1e3) ** 3, rtol=0.04)
    scene = trimesh.load(tmp_path / "surfaces" / "mapped.glb")
    assert set(scene.geometry) == {"organ", "tumour_1", "mapped_tumour_1", "mapped_false_1"}
    np.testing.assert_allclose(scene.geometry["mapped_tumour_1"].center_mass, in_organ_m, atol=3e-4)
    np.testing.assert_allclose(scene.geometry["tumour_1"].center_mass, in_organ_m, atol=1e-4)


def test_nothing_mapped_is_no_file(tmp_path) -> None:
    record = planted_run(tmp_path, true=[((0.0, 0.0, 0.0), R)], mapped=[])
    assert write_surfaces(record, findings_of(record)) == []
    assert not (tmp_path / "surfaces").exists()

"""A patient's files at the command line: inspected, run, and the map brought back to the millimetre."""

import csv
import dataclasses
import json
import os
import shutil
from pathlib import Path

import nibabel
import numpy as np
import pytest
import SimpleITK
import trimesh
from scanned_ball import CENTRE_MM, RADIUS_MM, TUMOUR_MM, ball_labels, grid, save_nifti
from scipy.spatial.transform import Rotation
from shared_runs import without_figures

from sim.cli.command_line import main
from sim.episode.setup import make_workspace, placed_organ
from sim.record.map_volumes import MapArrays, map_volumes, read_maps
from sim.running.fields import config_of
from sim.running.parts import scenario_of

ROOT = Path(__file__).resolve().parents[3]
LIVERS = Path(os.environ.get("SOUNDING_DATA", ROOT.parent / "shared" / "data")) / "livers"


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """An oblique scan of a ball with a tumour, and beside it a structure on its surface."""
    T, shape = grid(rotation=Rotation.from_rotvec([0.1, -0.2, 0.3]), half_mm=75.0)
    labels = ball_labels(T, shape)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    points_mm = index @ T[:3, :3].T + T[:3, 3]
    front_mm = CENTRE_MM + np.array([0.0, -RADIUS_MM - 4.0, 0.0])
    labels[(np.linalg.norm(points_mm - front_mm, axis=-1) < 9.0) & (labels == 0)] = 3
    return save_nifti(tmp_path_factory.mktemp("scan") / "case.nii.gz", labels, T)


FLAGS = ("--organ-label", "1", "--tumour-label", "2", "--keepout-label", "3")


@pytest.fixture(scope="module")
def run(scan):
    out = scan.parent / "run"
    files = ["episode", "--organ", str(scan), *FLAGS, "--keepout-mm", "6", "--organ-pose", "20", "-15", "70"]
    with without_figures():
        assert main([*files, "--steps", "2", "--arm", "none", "--no-report", "--out", str(out)]) == 0
    return out


def test_the_map_lies_over_the_scan_to_the_micrometre(run):
    (arrays,), T_world_organ = read_maps(run)
    i, j, k = 3, 7, 5
    world_m = np.array([arrays.axes_m[0][i], arrays.axes_m[1][j], arrays.axes_m[2][k], 1.0])
    config = json.loads((run / "config.json").read_text())
    lps_m = (np.array(config["T_input_world"]) @ world_m)[:3]
    assert np.array(config["T_input_world"]) @ T_world_organ == pytest.approx(np.eye(4), abs=1e-12)
    for name in ("map_probability", "map_standard_deviation", "map_labels"):
        path = run / f"{name}.nii.gz"
        image = SimpleITK.ReadImage(str(path))
        assert image.TransformIndexToPhysicalPoint((i, j, k)) == pytest.approx(lps_m * 1e3, abs=1e-3)
        affine = nibabel.load(path).affine
        assert (affine @ [i, j, k, 1.0])[:3] == pytest.approx(lps_m * [-1e3, -1e3, 1e3], abs=1e-3)
    probability = np.asarray(nibabel.load(run / "map_probability.nii.gz").dataobj)
    assert probability[arrays.is_inside] == pytest.approx(arrays.probability[arrays.is_inside])
    assert (probability[~arrays.is_inside] == 0.0).all()
    labels = np.asarray(nibabel.load(run / "map_labels.nii.gz").dataobj)
    assert np.array_equal(labels == 2, probability > 0.5)


def test_a_map_that_knew_the_truth_overlays_the_scans_own_labels(run, scan):
    # The truth in place of the probability, written, read by SimpleITK and brought to the scan's own grid.
    (arrays,), T_world_organ = read_maps(run)
    with np.load(run / "map.npz") as file:
        knowing = dataclasses.replace(arrays, probability=file["is_tumour"].astype(float))
    path = run.parent / "truth.nii.gz"
    path.write_bytes(map_volumes(knowing, T_world_organ)["map_labels.nii.gz"])
    given = SimpleITK.ReadImage(str(scan))
    resampled = SimpleITK.Resample(
        SimpleITK.ReadImage(str(path)), given, SimpleITK.Transform(), SimpleITK.sitkNearestNeighbor
    )
    brought, labels = SimpleITK.GetArrayFromImage(resampled), SimpleITK.GetArrayFromImage(given)
    for label in (1, 2):  # steps of 3 mm on both grids; a shift of one would cost a tumour of 22 mm 0.2
        one, other = brought == label, labels == label
        assert 2 * (one & other).sum() / (one.sum() + other.sum()) > 0.85
    found_mm = np.array(
        resampled.TransformIndexToPhysicalPoint([int(n) for n in np.argwhere(brought == 2)[0][::-1]])
    )
    assert np.linalg.norm(found_mm - TUMOUR_MM) < 15.0


def test_export_writes_the_same_files_again_and_obeys_the_threshold(run, tmp_path, capsys):
    assert main(["export", str(run), "--out", str(tmp_path)]) == 0
    for name in ("map_probability.nii.gz", "map_standard_deviation.nii.gz", "map_labels.nii.gz"):
        assert (tmp_path / name).read_bytes() == (run / name).read_bytes()
    assert main(["export", str(run), "--out", str(tmp_path), "--threshold", "0.001"]) == 0
    low = np.asarray(nibabel.load(tmp_path / "map_labels.nii.gz").dataobj)
    half = np.asarray(nibabel.load(run / "map_labels.nii.gz").dataobj)
    assert (low == 2).sum() > (half == 2).sum()
    capsys.readouterr()
    assert main(["export", str(tmp_path)]) == 2
    assert "holds no map.npz" in capsys.readouterr().err


def test_a_map_that_knew_the_truth_is_the_scans_own_labels_voxel_by_voxel(run, scan, tmp_path):
    # The truth in place of the probability, in a copy of the run's folder.
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    with np.load(run / "map.npz") as file:
        arrays = dict(file)
    arrays["probability"] = np.where(arrays["is_inside"], arrays["is_tumour"], np.nan).astype(np.float32)
    np.savez(copy / "map.npz", **arrays)
    assert main(["export", str(copy), "--out", str(tmp_path / "out")]) == 0
    given = nibabel.load(scan)
    labels = np.asarray(given.dataobj)
    for name in ("probability", "labels"):
        image = nibabel.load(tmp_path / "out" / f"map_on_scan_{name}.nii.gz")
        assert image.shape == given.shape
        # Header's numbers are kept in single precision; the qform's quaternion leaves 0.02 degrees.
        assert image.affine == pytest.approx(given.affine, abs=1e-4)
        assert image.header.get_qform() == pytest.approx(given.affine, abs=0.05)
        assert int(image.header["sform_code"]) == int(image.header["qform_code"]) == 1
        read = SimpleITK.ReadImage(str(tmp_path / "out" / f"map_on_scan_{name}.nii.gz"))
        corner = [n - 1 for n in given.shape]
        there = SimpleITK.ReadImage(str(scan)).TransformIndexToPhysicalPoint(corner)
        assert read.TransformIndexToPhysicalPoint(corner) == pytest.approx(there, abs=1e-2)
    mapped = np.asarray(nibabel.load(tmp_path / "out" / "map_on_scan_labels.nii.gz").dataobj)
    for is_mapped, is_true in ((mapped == 2, labels == 2), (mapped > 0, (labels == 1) | (labels == 2))):
        # No voxel shift: the middles agree to a tenth of a voxel, and what differs lies at the surface.
        middles = [np.argwhere(each).mean(axis=0) for each in (is_mapped, is_true)]
        assert np.abs(middles[0] - middles[1]).max() < 0.15
        assert 2 * (is_mapped & is_true).sum() / (is_mapped.sum() + is_true.sum()) > 0.9
    probability = nibabel.load(tmp_path / "out" / "map_on_scan_probability.nii.gz").get_fdata()
    assert np.array_equal(probability > 0.5, mapped == 2)
    assert probability.max() == pytest.approx(1.0, abs=0.004)
    assert (probability[mapped == 0] == 0.0).all()


def test_what_no_cone_can_see_has_a_label_and_a_share(run, tmp_path):
    (arrays,), _ = read_maps(run)
    labels = np.asarray(nibabel.load(run / "map_labels.nii.gz").dataobj)
    assert arrays.is_visible is not None
    unseen = arrays.is_inside & ~arrays.is_visible
    assert np.array_equal(labels == 4, unseen & (arrays.probability <= 0.5))
    summary = json.loads((run / "summary.json").read_text())
    assert summary["visible_fraction"] == pytest.approx(1.0 - unseen.sum() / arrays.is_inside.sum())
    assert 0.5 < summary["visible_fraction"] < 1.0
    assert json.loads((run / "findings.json").read_text())["visible_fraction"] == summary["visible_fraction"]
    # A folder of an older run says nothing of it, and its labels are LiTS's alone.
    old = tmp_path / "old"
    shutil.copytree(run, old)
    (old / "visible.npz").unlink()
    assert main(["export", str(old), "--out", str(tmp_path / "out")]) == 0
    assert set(np.unique(nibabel.load(tmp_path / "out" / "map_labels.nii.gz").dataobj)) <= {0, 1, 2}


def test_a_scan_that_is_gone_is_told_and_the_rest_is_written(run, tmp_path, capsys):
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    text = (copy / "config.json").read_text().replace("case.nii.gz", "gone.nii.gz")
    (copy / "config.json").write_text(text)
    assert main(["export", str(copy), "--out", str(tmp_path / "out")]) == 0
    assert "gone.nii.gz" in capsys.readouterr().err
    assert (tmp_path / "out" / "map_labels.nii.gz").is_file()
    assert not (tmp_path / "out" / "map_on_scan_labels.nii.gz").exists()


def test_an_uneven_lattice_is_refused():
    x_m = np.array([0.0, 0.003, 0.007])
    field = np.zeros((3, 3, 3))
    arrays = MapArrays(
        axes_m=(x_m, x_m, x_m), probability=field, latent_variance=field, is_inside=np.ones((3, 3, 3), bool)
    )
    with pytest.raises(ValueError, match="not even"):
        map_volumes(arrays, np.eye(4))


def test_poses_near_what_must_not_be_pressed_are_left_out(scan):
    options = config_of(organ=scan, organ_label=(1,), tumour_label=(2,), keepout_label=(3,), keepout_mm=6.0)
    placed, _ = placed_organ(scenario_of(options))
    (structure,) = placed.structures
    workspace = make_workspace(scenario_of(options), placed)
    assert structure.distance_m(workspace.positions_m).min() > 0.006
    free = dataclasses.replace(placed, structures=(dataclasses.replace(structure, is_keepout=False),))
    all_poses = make_workspace(scenario_of(options), free).positions_m
    near = structure.distance_m(all_poses) <= 0.006
    # The structure lies on the ball's front, which is up: a cap of it is lost, and nothing else.
    assert 0.01 < near.mean() < 0.15
    assert workspace.n_poses == (~near).sum()


def test_a_distance_that_leaves_no_pose_is_refused(scan, capsys):
    files = ["episode", "--organ", str(scan), *FLAGS, "--keepout-mm", "100", "--arm", "none"]
    assert main([*files, "--out", str(scan.parent / "none")]) == 2
    assert "lower --keepout-mm" in capsys.readouterr().err


def test_distances_of_structures_to_tumours_are_told(run):
    with (run / "structures.csv").open() as file:
        rows = list(csv.DictReader(file))
    (true,) = [row for row in rows if row["tumour"] == "true"]
    assert true["structure"] == "label 3"
    front_mm = CENTRE_MM + np.array([0.0, -RADIUS_MM - 4.0, 0.0])
    gap_mm = np.linalg.norm(front_mm - TUMOUR_MM) - 9.0 - 11.0
    assert float(true["distance_m"]) * 1e3 == pytest.approx(gap_mm, abs=3.0)  # a voxel
    assert all(float(row["distance_m"]) > 0.0 for row in rows)


def test_inspect_says_what_is_there_and_what_to_do(scan, tmp_path, capsys):
    picture = tmp_path / "case.png"
    assert main(["inspect", str(scan), *FLAGS, "--out", str(picture)]) == 0
    printed = capsys.readouterr().out
    assert "axes LPS, oblique by" in printed
    assert "tumours: 1, " in printed
    assert "label 3: must not be pressed" in printed
    assert picture.stat().st_size > 20_000
    assert main(["inspect", str(scan)]) == 1
    assert "Pass --organ-label N" in capsys.readouterr().out
    assert main(["inspect", str(tmp_path / "absent.nii")]) == 2
    assert "no such file" in capsys.readouterr().err


def test_inspect_tells_of_tumours_outside_and_of_repairs(no_figures, tmp_path, capsys):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=60.0)
    ball.invert()
    ball.export(tmp_path / "organ.stl")
    far = trimesh.creation.icosphere(radius=8.0)
    far.apply_translation([200.0, 0.0, 0.0])
    far.export(tmp_path / "far.stl")
    asked = ["inspect", str(tmp_path / "organ.stl"), "--tumour", str(tmp_path / "far.stl")]
    assert main([*asked, "--out", str(tmp_path / "p.png")]) == 1
    printed = capsys.readouterr().out
    assert "far.stl: 0% of it lies in the organ" in printed
    assert "inside out and the winding was reversed" in printed


def test_labels_asked_of_a_mesh_are_refused(tmp_path, capsys):
    trimesh.creation.icosphere(subdivisions=3, radius=60.0).export(tmp_path / "organ.stl")
    asked = ["episode", "--organ", str(tmp_path / "organ.stl"), "--organ-label", "1", "--arm", "none"]
    assert main([*asked, "--out", str(tmp_path / "out")]) == 2
    assert "labels go with a label volume" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", ["glb", "gltf", "ply", "obj"])
def test_meshes_of_each_format_are_organs(tmp_path, suffix):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.06)
    scene = trimesh.Scene()
    scene.add_geometry(ball, transform=trimesh.transformations.translation_matrix([0.1, 0.2, 0.3]))
    path = tmp_path / f"organ.{suffix}"
    (scene if suffix.startswith("gl") else scene.to_mesh()).export(path)
    loaded = placed_organ(scenario_of(config_of(organ=path, unit="m")))[0]
    T_organ_world = np.linalg.inv(loaded.T_world_organ)
    middle_m = T_organ_world @ [*loaded.organ.bounds_m.mean(axis=0), 1.0]
    assert middle_m[:3] == pytest.approx([0.1, 0.2, 0.3], abs=1e-6)


def test_a_mesh_that_says_ras_is_turned_to_lps(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=60.0)
    ball.apply_translation([30.0, 40.0, 50.0])
    ball.export(tmp_path / "organ.stl")
    content = bytearray((tmp_path / "organ.stl").read_bytes())
    content[:80] = b"3D Slicer output. SPACE=RAS".ljust(80)
    (tmp_path / "organ.stl").write_bytes(bytes(content))
    loaded, notices = placed_organ(scenario_of(config_of(organ=tmp_path / "organ.stl")))
    middle_m = np.linalg.inv(loaded.T_world_organ) @ [*loaded.organ.bounds_m.mean(axis=0), 1.0]
    assert middle_m[:3] == pytest.approx([-0.03, -0.04, 0.05], abs=1e-6)
    assert any("RAS axes, which were turned" in notice for notice in notices)


def test_a_mesh_of_very_many_triangles_is_simplified_and_said_so(tmp_path):
    ball = trimesh.creation.uv_sphere(radius=60.0, count=(225, 225))  # 200,700 triangles
    ball.export(tmp_path / "organ.stl")
    loaded, notices = placed_organ(scenario_of(config_of(organ=tmp_path / "organ.stl")))
    assert len(loaded.organ.faces) <= 100_000
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.06**3, rel=1e-3)
    assert any(f"{len(ball.faces):,} triangles were simplified to" in notice for notice in notices)


@pytest.mark.skipif(not LIVERS.is_dir(), reason=f"no livers in {LIVERS}; set SOUNDING_DATA")
def test_a_real_scan_runs_with_the_arm(no_figures, tmp_path):
    organ = LIVERS / "lits_016_outline" / "segmentation.nii.gz"
    files = ["episode", "--organ", str(organ), "--n-tumours", "2", "--motion", "none"]
    assert main([*files, "--steps", "3", "--no-report", "--out", str(tmp_path / "run")]) == 0
    summary = json.loads((tmp_path / "run/summary.json").read_text())
    assert summary["n_sensings"] == 3
    assert summary["attainable_fraction"] > 0.8

"""Files far larger than what they hold: read part by part, and refused by name where memory would not do."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import nrrd
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scanned_ball import save_nifti
from scipy.ndimage import binary_fill_holes

from sim.cli.command_line import main
from sim.world import memory
from sim.world.errors import MeshError, VolumeError
from sim.world.meshes.meshes import load_mesh
from sim.world.volumes.files import load_volume
from sim.world.volumes.gathered_labels import GatheredLabels
from sim.world.volumes.label_values import SLAB_VOXELS
from sim.world.volumes.masks import filled

SHAPE = (256, 256, 200)
BALL = (slice(40, 90), slice(100, 130), slice(55, 145))


@pytest.fixture(scope="module")
def sparse() -> np.ndarray:
    """A large scan of which little is labelled, more than one part of it."""
    labels = np.zeros(SHAPE, dtype=np.int16)
    labels[BALL] = 1
    labels[60:70, 110:120, 80:100] = 2
    assert labels.size > 3 * SLAB_VOXELS
    return labels


@pytest.mark.parametrize("name", ["scan.nii.gz", "scan.nii", "scan.nrrd"])
def test_only_what_is_labelled_is_kept_and_lies_where_it_lay(tmp_path, sparse, name) -> None:
    T = np.diag([0.7, 0.8, 1.5, 1.0])
    if name.endswith("nrrd"):
        header = {"space": "LPS", "space directions": T[:3, :3], "space origin": T[:3, 3], "encoding": "raw"}
        nrrd.write(str(tmp_path / name), sparse, header)
    else:
        save_nifti(tmp_path / name, sparse, T)
    tracemalloc.start()
    volume = load_volume(tmp_path / name)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert volume.scan_shape == SHAPE
    assert volume.box == BALL
    np.testing.assert_array_equal(volume.labels, sparse[BALL])
    assert volume.counts == {1: int((sparse == 1).sum()), 2: 2000}
    first_mm = [40 * 0.7, 100 * 0.8, 55 * 1.5]
    np.testing.assert_allclose(volume.T_lps_voxel[:3, 3] * 1e3, first_mm, atol=1e-3)
    if name == "scan.nii.gz":  # less than the voxels alone take
        assert peak_bytes < sparse.nbytes


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint16, np.int32, np.float32, np.float64])
def test_the_type_of_the_voxels_tells_nothing(tmp_path, sparse, dtype) -> None:
    volume = load_volume(save_nifti(tmp_path / "scan.nii.gz", sparse[::2, ::2, ::2].astype(dtype), np.eye(4)))
    np.testing.assert_array_equal(volume.labels, sparse[::2, ::2, ::2][volume.box])
    assert volume.notices == ()


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_labels_gathered_in_parts_are_the_labels(seed, thickness) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(2, 9, 3))
    labels = rng.integers(1, 7, shape) * (rng.random(shape) < rng.choice([0.02, 0.2, 1.0]))
    gathered = GatheredLabels(Path("x.nii"))
    for first in range(0, shape[2], thickness):
        gathered.add(labels[:, :, first : first + thickness])
    if not labels.any():
        with pytest.raises(VolumeError, match="only background"):
            gathered.together()
        return
    found, box, counts = gathered.together()
    whole = np.zeros(shape)
    whole[box] = found
    np.testing.assert_array_equal(whole, labels)
    assert all(found.take(end, axis=axis).any() for axis in range(3) for end in (0, -1))
    assert counts == {int(each): int((labels == each).sum()) for each in np.unique(labels[labels > 0])}


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_cavities_are_filled_as_scipy_fills_them(seed) -> None:
    rng = np.random.default_rng(seed)
    mask = rng.random(rng.integers(1, 12, 3)) < rng.uniform(0.3, 0.95)
    np.testing.assert_array_equal(filled(mask), binary_fill_holes(mask))


def test_a_file_cut_short_is_named_wherever_it_ends(tmp_path, sparse) -> None:
    path = save_nifti(tmp_path / "scan.nii.gz", sparse, np.eye(4))
    content = path.read_bytes()
    for share in (0.3, 0.999):
        path.write_bytes(content[: int(share * len(content))])
        with pytest.raises(VolumeError, match=r"scan\.nii\.gz: the file is cut short"):
            load_volume(path)


def test_what_memory_does_not_hold_is_refused_with_the_need_and_the_remedy(
    tmp_path, sparse, monkeypatch, capsys
) -> None:
    scan = save_nifti(tmp_path / "scan.nii.gz", sparse, np.eye(4))
    mesh = tmp_path / "liver.stl"
    trimesh.creation.icosphere(subdivisions=6, radius=80.0).export(mesh)  # 81,920 triangles, 66 MiB in memory
    monkeypatch.setattr(memory, "_memory_bytes", lambda: 50 * 2**20)
    with pytest.raises(
        VolumeError, match=r"scan\.nii\.gz: 256 x 256 x 200 .* may take 0\.0488 GiB.* crop it"
    ):
        load_volume(scan)
    with pytest.raises(MeshError, match=r"liver\.stl: .* 0\.0819 million triangles.* 0\.0649 GiB.*decimate"):
        load_mesh(mesh)
    for file in (scan, mesh):
        assert main(["inspect", str(file), "--out", str(tmp_path / "x.png")]) != 0
        said = capsys.readouterr()
        assert file.name in said.err + said.out
        assert "Traceback" not in said.err


def test_a_containers_limit_counts(tmp_path, monkeypatch) -> None:
    limit = tmp_path / "memory.max"
    monkeypatch.setattr(memory, "CONTAINER_LIMIT", limit)
    machine = memory.spare_bytes()  # the file is not there
    for text, spare in (("max\n", machine), ("1000000\n", 4e5), (f"{2**62}\n", machine), ("\xff\n", machine)):
        limit.write_text(text, encoding="latin-1")
        assert memory.spare_bytes() == spare

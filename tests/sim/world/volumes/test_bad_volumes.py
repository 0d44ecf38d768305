"""Volumes that hold no segmentation, or are damaged: one clear error each, and no harm."""

import gzip
import time
import tracemalloc

import nrrd
import numpy as np
import pytest
from scanned_ball import (
    ball_labels,
    default_file,
    grid,
    load,
    save_nifti,
)

from sim.world.errors import WorldError
from sim.world.volumes.files import load_volume
from sim.world.volumes.label_coding import LabelChoice


def noise(shape=(30, 30, 30), low=-1000, high=1500):
    return np.random.default_rng(0).integers(low, high, shape).astype(np.int16)


BAD_ARRAYS = {
    "empty": (np.zeros((20, 20, 20), np.uint8), {}, "holds no label, only background"),
    "an image": (noise(), {}, "looks like the scan itself"),
    "an image without negatives": (noise(low=0), {}, "looks like the scan itself"),
    "fractions": (np.linspace(0, 7, 8000).reshape(20, 20, 20).astype(np.float32), {}, "looks like the scan"),
    "4D": (np.ones((9, 9, 9, 3), np.uint8), {}, r"has 4 axes, of 9 x 9 x 9 x 3"),
    "a slice": (np.ones((20, 20, 1), np.uint8), {}, "are no volume"),
    "colours": (
        np.zeros((9, 9, 9), dtype=[("R", "u1"), ("G", "u1"), ("B", "u1")]),
        {},
        "save whole numbers, one label per voxel",
    ),
    "many labels": (
        np.arange(1, 28).reshape(3, 3, 3).astype(np.int16),
        {},
        "which of its labels is the organ.* `coding` lits, msd-liver, 3d-ircadb, totalsegmentator or "
        "totalsegmentator-v1",
    ),
    "confetti": (
        (np.random.default_rng(1).uniform(size=(60, 60, 60)) < 0.08).astype(np.uint8),
        {},
        r"scattered over [\d,]+ pieces",
    ),
    "no such label": (
        np.ones((20, 20, 20), np.uint8),
        {"organ": (3,)},
        r"`organ_label` 3 is not in the file",
    ),
    "no such tumour": (np.ones((20, 20, 20), np.uint8), {"tumours": (8,)}, r"`tumour_label` 8 is not in"),
    "wrong coding": (np.ones((20, 20, 20), np.uint8), {"coding": "totalsegmentator"}, "5 is not in the file"),
}


@pytest.mark.parametrize("case", BAD_ARRAYS, ids=str)
def test_what_is_no_segmentation_is_refused_with_the_remedy(tmp_path, case):
    array, choice, message = BAD_ARRAYS[case]
    path = save_nifti(tmp_path / "seg.nii.gz", array, np.diag([3.0, 3.0, 3.0, 1.0]))
    with pytest.raises(WorldError, match=rf"seg\.nii\.gz: .*{message}"):
        load(path, labels=LabelChoice(**choice))


def test_files_that_hold_no_volume_are_named(tmp_path):
    for name, content in [
        ("words.nii", b"this is not a scan" * 40),
        ("words.nii.gz", b"this is not a scan" * 40),
        ("zipped.nii.gz", gzip.compress(b"neither is this" * 60)),
        ("empty.nii.gz", b""),
        ("words.nrrd", b"this is not a scan"),
        ("empty.nrrd", b""),
        ("bare.nrrd", b"NRRD0004\n\n"),
        ("list.nhdr", b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: LIST\n"),
    ]:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(WorldError, match=name.replace(".", r"\.")):
            load(tmp_path / name)
    with pytest.raises(WorldError, match="no such file"):
        load(tmp_path / "absent.nii.gz")


def test_a_header_of_impossible_axes_is_refused_or_overruled(tmp_path):
    T, shape = grid((2.5, 2.5, 2.5))
    labels = ball_labels(T, shape)
    flat = np.diag([2.5, 2.5, 2.5, 1.0])
    flat[:3, 2] = flat[:3, 1]
    with pytest.raises(WorldError, match="axes lie in one plane"):
        load(save_nifti(tmp_path / "flat.nii.gz", labels, flat))
    path = save_nifti(tmp_path / "huge.nii.gz", labels, np.diag([200.0, 200.0, 200.0, 1.0]))
    with pytest.raises(WorldError, match="pass the scan's own as `spacing_mm`"):
        load(path)
    loaded = load(path, spacing_m=(2.5e-3,) * 3)
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.055**3, rel=0.02)


def test_a_volume_that_memory_cannot_hold_is_refused_before_it_is_read(tmp_path):
    path = default_file(tmp_path, "seg.nii")
    content = bytearray(path.read_bytes())
    content[42:48] = np.array([30_000] * 3, dtype="<i2").tobytes()  # dim[1..3]: 27 million million voxels
    path.write_bytes(bytes(content))
    with pytest.raises(WorldError, match=r"30000 x 30000 x 30000 voxels may take .* GiB.*crop it"):
        load_volume(path)
    content[42:48] = np.array([900] * 3, dtype="<i2").tobytes()
    path.write_bytes(bytes(content))
    with pytest.raises(WorldError, match="cut short"):
        load_volume(path)


def test_a_small_file_that_unpacks_to_gigabytes_takes_no_memory(tmp_path):
    header = "NRRD0004\ntype: uchar\ndimension: 3\nspace: LPS\nsizes: 30 30 30\nencoding: gzip\n"
    header += "space directions: (3,0,0) (0,3,0) (0,0,3)\nspace origin: (0,0,0)\n\n"
    bomb = gzip.compress(bytes(300 * 2**20), 9)
    (tmp_path / "bomb.nrrd").write_bytes(header.encode() + bomb)
    tracemalloc.start()
    with pytest.raises(WorldError, match="only background"):
        load_volume(tmp_path / "bomb.nrrd")
    assert tracemalloc.get_traced_memory()[1] < 60 * 2**20
    tracemalloc.stop()


@pytest.mark.parametrize("name", ["seg.nii", "seg.nii.gz", "seg.nrrd"])
def test_truncated_and_flipped_volumes_never_give_another_error(tmp_path, name):
    rng = np.random.default_rng(5)
    T, shape = grid((6.0, 6.0, 6.0))
    path = tmp_path / name
    if name.endswith("nrrd"):
        header = {"space": "LPS", "space directions": T[:3, :3].T, "space origin": T[:3, 3]}
        nrrd.write(str(path), ball_labels(T, shape), header)
    else:
        save_nifti(path, ball_labels(T, shape), T)
    content = path.read_bytes()
    n_refused, start_s = 0, time.process_time()
    for trial in range(150):
        damaged = bytearray(content[: rng.integers(len(content))] if trial % 3 == 0 else content)
        for _ in range(rng.integers(1, 6)):
            if damaged:  # half of the damage is to the header, where it is worst
                end = min(len(damaged), 400) if trial % 2 else len(damaged)
                damaged[rng.integers(end)] ^= 1 << rng.integers(8)
        path.write_bytes(bytes(damaged))
        try:
            load_volume(path)
        except WorldError as error:
            n_refused += name in str(error)
    assert n_refused >= 40  # truncations at least
    assert (
        time.process_time() - start_s < 120.0
    )  # not a speed: no damage makes the reader work on without end

"""Label volumes: what a segmentation holds comes out in the right place and size, and no file can do harm."""

import gzip
import time
import tracemalloc

import nibabel
import nrrd
import numpy as np
import pytest
import SimpleITK
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim.world.anatomy_files import AnatomyFiles, load_anatomy
from sim.world.errors import WorldError
from sim.world.label_coding import LabelChoice
from sim.world.volume_files import load_volume

CENTRE_MM = np.array([-60.0, -20.0, 40.0])
"""Of the organ, LPS."""
TUMOUR_MM = CENTRE_MM + np.array([18.0, -10.0, 12.0])
RADIUS_MM, TUMOUR_RADIUS_MM = 55.0, 11.0


def ball_labels(T_lps_mm, shape):
    """A ball of label 1 with a smaller one of label 2 in it, on a grid."""
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    points_mm = index @ T_lps_mm[:3, :3].T + T_lps_mm[:3, 3]
    labels = (np.linalg.norm(points_mm - CENTRE_MM, axis=-1) < RADIUS_MM).astype(np.uint8)
    labels[np.linalg.norm(points_mm - TUMOUR_MM, axis=-1) < TUMOUR_RADIUS_MM] = 2
    return labels


def grid(spacing_mm=(3.0, 3.0, 3.0), rotation=None, half_mm=66.0, flip=(1, 1, 1)):
    """An affine map about the organ's centre and a shape that holds it."""
    R = np.eye(3) if rotation is None else rotation.as_matrix()
    shape = tuple(int(np.ceil(2 * half_mm / s)) + 1 for s in spacing_mm)
    T = np.eye(4)
    T[:3, :3] = R @ np.diag(np.array(spacing_mm) * flip)
    T[:3, 3] = CENTRE_MM - T[:3, :3] @ ((np.array(shape) - 1) / 2)
    return T, shape


def save_nifti(path, labels, T_lps_mm, **header):
    image = nibabel.Nifti1Image(labels, np.diag([-1.0, -1.0, 1.0, 1.0]) @ T_lps_mm)
    for key, value in header.items():
        image.header[key] = value
    nibabel.save(image, path)
    return path


def default_file(tmp_path, name="seg.nii.gz", dtype=np.uint8):
    T, shape = grid()
    return save_nifti(tmp_path / name, ball_labels(T, shape).astype(dtype), T)


def load(path, **options):
    return load_anatomy(AnatomyFiles(organ=str(path), **options))


def assert_is_the_ball(loaded, *, rel=0.02, abs_mm=0.4):
    # Voxels of 3 mm count a ball of 55 mm within a hundredth.
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * (RADIUS_MM * 1e-3) ** 3, rel=rel)
    assert loaded.organ.bounds_m.mean(axis=0) * 1e3 == pytest.approx(CENTRE_MM, abs=abs_mm)
    (tumour,) = loaded.tumours
    assert tumour.volume_m3 == pytest.approx(4 / 3 * np.pi * (TUMOUR_RADIUS_MM * 1e-3) ** 3, rel=0.08)
    middle_m = tumour.sample_inside(4000, np.random.default_rng(0)).mean(axis=0)
    assert middle_m * 1e3 == pytest.approx(TUMOUR_MM, abs=2 * abs_mm)


@pytest.mark.parametrize("flip", [(1, 1, 1), (-1, 1, 1), (-1, -1, -1), (1, -1, 1)])
def test_any_orientation_lies_at_the_same_place(tmp_path, flip):
    T, shape = grid(flip=flip)
    assert_is_the_ball(load(save_nifti(tmp_path / "seg.nii.gz", ball_labels(T, shape), T)))


@pytest.mark.parametrize("spacing_mm", [(0.9, 0.9, 5.0), (2.0, 3.0, 1.5)])
def test_any_spacing_gives_the_same_volumes(tmp_path, spacing_mm):
    T, shape = grid(spacing_mm)
    assert_is_the_ball(load(save_nifti(tmp_path / "seg.nii", ball_labels(T, shape), T)), abs_mm=1.0)


def test_an_oblique_scan_lies_where_its_affine_says_and_is_remarked_on(tmp_path):
    T, shape = grid(rotation=Rotation.from_rotvec([0.2, -0.35, 0.5]), half_mm=75.0)
    loaded = load(save_nifti(tmp_path / "seg.nii.gz", ball_labels(T, shape), T))
    assert_is_the_ball(loaded)
    assert any("oblique by" in notice for notice in loaded.notices)


@settings(max_examples=8, deadline=None)
@given(
    axis=st.tuples(*[st.floats(-2.0, 2.0)] * 3),
    spacing_mm=st.tuples(*[st.floats(2.0, 5.0)] * 3),
    flip=st.tuples(*[st.sampled_from([-1, 1])] * 3),
)
def test_simpleitk_and_this_reader_agree_on_where_voxels_lie(tmp_path_factory, axis, spacing_mm, flip):
    T, shape = grid(spacing_mm, Rotation.from_rotvec(axis), half_mm=20.0, flip=flip)
    folder = tmp_path_factory.mktemp("itk")
    labels = ball_labels(T, shape)
    image = SimpleITK.GetImageFromArray(labels.T)
    image.SetSpacing([float(s) for s in spacing_mm])
    image.SetDirection((T[:3, :3] / np.array(spacing_mm)).ravel())
    image.SetOrigin(T[:3, 3])
    corner = [n - 1 for n in shape]
    expected_m = np.array(image.TransformIndexToPhysicalPoint(corner)) * 1e-3
    for name in ("a.nrrd", "a.nii.gz", "a.nii"):
        SimpleITK.WriteImage(image, str(folder / name))
        volume = load_volume(folder / name)
        assert np.array_equal(volume.labels, labels)
        # NIfTI keeps its affine in single precision.
        assert (volume.T_lps_voxel @ [*corner, 1.0])[:3] == pytest.approx(expected_m, abs=2e-6)


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2"])
@pytest.mark.parametrize("space", ["left-posterior-superior", "right-anterior-superior"])
def test_nrrd_is_read_in_each_encoding_and_space(tmp_path, encoding, space):
    T, shape = grid()
    turn = np.diag([1.0, 1, 1]) if space.startswith("left") else np.diag([-1.0, -1, 1])
    header = {
        "space": space,
        "space directions": (turn @ T[:3, :3]).T,
        "space origin": turn @ T[:3, 3],
        "encoding": encoding,
    }
    path = tmp_path / "seg.nrrd"
    nrrd.write(str(path), ball_labels(T, shape), header)
    assert_is_the_ball(load(path))


def test_a_detached_header_is_read_and_one_that_points_elsewhere_is_not(tmp_path):
    T, shape = grid()
    header = {"space": "LPS", "space directions": T[:3, :3].T, "space origin": T[:3, 3], "encoding": "gzip"}
    path = tmp_path / "seg.nhdr"
    nrrd.write(str(path), ball_labels(T, shape), header, detached_header=True)
    assert_is_the_ball(load(path))
    text = path.read_text()
    path.write_text(text.replace("data file: ", "data file: ../"))
    with pytest.raises(WorldError, match=r"seg\.nhdr.*keep header and one data file together"):
        load(path)


def test_names_that_slicer_gives_segments_tell_the_organ(tmp_path):
    T, shape = grid()
    labels = np.choose(ball_labels(T, shape), [0, 7, 9]).astype(np.uint8)
    labels[:4, :4, :4] = 3
    header = {"space": "LPS", "space directions": T[:3, :3].T, "space origin": T[:3, 3]}
    for index, (name, value) in enumerate([("Liver", 7), ("Liver tumor", 9), ("Gallbladder", 3)]):
        header |= {f"Segment{index}_Name": name, f"Segment{index}_LabelValue": str(value)}
    path = tmp_path / "case.seg.nrrd"
    nrrd.write(str(path), labels, header)
    loaded = load(path)
    assert_is_the_ball(loaded)
    assert [structure.name for structure in loaded.structures] == ["Gallbladder"]


@pytest.mark.parametrize("dtype", [np.int16, np.uint16, np.int32, np.float32, np.float64])
def test_labels_may_be_kept_in_any_type(tmp_path, dtype):
    assert_is_the_ball(load(default_file(tmp_path, dtype=dtype)))


def test_a_mask_of_one_value_is_the_organ_and_a_coding_by_name_is_obeyed(tmp_path):
    T, shape = grid()
    labels = ball_labels(T, shape)
    mask = save_nifti(tmp_path / "liver.nii.gz", np.where(labels > 0, 255, 0).astype(np.uint8), T)
    tumour = save_nifti(tmp_path / "tumour01.nii.gz", np.where(labels == 2, 255, 0).astype(np.uint8), T)
    choice = LabelChoice(coding="3d-ircadb")
    assert_is_the_ball(load(mask, tumours=(str(tumour),), labels=choice))
    total = np.choose(labels, [0, 5, 5]).astype(np.uint8)
    total[:5, :5, :5] = 4
    path = save_nifti(tmp_path / "total.nii.gz", total, T)
    loaded = load(path, labels=LabelChoice(coding="totalsegmentator"), tumours=(str(tumour),))
    assert_is_the_ball(loaded)
    assert [structure.name for structure in loaded.structures] == ["gallbladder"]
    assert not loaded.structures[0].is_keepout


def test_labels_by_number_take_precedence_and_keepouts_are_marked(tmp_path):
    T, shape = grid()
    labels = np.choose(ball_labels(T, shape), [0, 40, 41]).astype(np.uint8)
    labels[:6, :6, :6] = 42
    path = save_nifti(tmp_path / "seg.nii.gz", labels, T)
    choice = LabelChoice(organ=(40,), tumours=(41,), keepouts=(42,))
    loaded = load(path, labels=choice)
    assert_is_the_ball(loaded)
    assert [(each.name, each.is_keepout) for each in loaded.structures] == [("label 42", True)]


def test_every_separate_piece_is_a_tumour_and_noise_is_not(tmp_path):
    T, shape = grid()
    labels = ball_labels(T, shape)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    points_mm = index @ T[:3, :3].T + T[:3, 3]
    labels[np.linalg.norm(points_mm - (CENTRE_MM - [20, 10, 5]), axis=-1) < 7.0] = 2
    labels[2, 2, 2] = 2  # outside the organ
    path = save_nifti(tmp_path / "seg.nii.gz", labels, T)
    loaded = load(path)
    assert len(loaded.tumours) == 2
    assert loaded.tumours[0].volume_m3 > loaded.tumours[1].volume_m3  # the largest first
    assert loaded.tumour_names == ("seg.nii.gz: tumour 1", "seg.nii.gz: tumour 2")
    assert any("1 tumour piece outside the organ, was dropped" in notice for notice in loaded.notices)


def test_islands_beside_the_organ_are_dropped_and_counted(tmp_path):
    T, shape = grid()
    labels = ball_labels(T, shape)
    rng = np.random.default_rng(0)
    labels[(labels == 0) & (rng.uniform(size=shape) < 0.01)] = 1
    loaded = load(save_nifti(tmp_path / "seg.nii.gz", labels, T))
    assert_is_the_ball(loaded, rel=0.03)
    assert any("islands were dropped beside the organ" in notice for notice in loaded.notices)


def test_an_organ_cut_by_the_scan_is_closed_and_said_so(tmp_path):
    T, shape = grid()
    path = save_nifti(tmp_path / "seg.nii.gz", ball_labels(T, shape)[:, :, :24], T)
    loaded = load(path)
    assert loaded.organ.to_trimesh().is_watertight
    assert any("cut off at the end of the scan" in notice for notice in loaded.notices)


def test_a_lost_spacing_is_noticed_and_can_be_given(tmp_path):
    T, shape = grid((2.5, 2.5, 2.5))
    path = save_nifti(tmp_path / "seg.nii.gz", ball_labels(T, shape), np.eye(4))
    loaded = load(path)
    assert any("pass the scan's own spacing as --spacing-mm" in notice for notice in loaded.notices)
    spaced = load(path, spacing_m=(2.5e-3,) * 3)
    assert spaced.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.055**3, rel=0.02)


def test_probabilities_are_cut_at_one_half_and_said_so(tmp_path):
    T, shape = grid()
    soft = np.clip((ball_labels(T, shape) > 0) * 0.8 + 0.1, 0, 1).astype(np.float32)
    soft[0, 0, 0] = np.nan
    loaded = load(save_nifti(tmp_path / "soft.nii.gz", soft, T))
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.055**3, rel=0.02)
    assert any("above 0.5 are taken for label 1" in notice for notice in loaded.notices)
    assert any("1 voxels are NaN" in notice for notice in loaded.notices)


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
        "which of its labels is the organ",
    ),
    "confetti": (
        (np.random.default_rng(1).uniform(size=(60, 60, 60)) < 0.08).astype(np.uint8),
        {},
        r"scattered over [\d,]+ pieces",
    ),
    "no such label": (
        np.ones((20, 20, 20), np.uint8),
        {"organ": (3,)},
        r"--organ-label 3 is not in the file",
    ),
    "no such tumour": (np.ones((20, 20, 20), np.uint8), {"tumours": (8,)}, r"--tumour-label 8 is not in"),
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
    with pytest.raises(WorldError, match="pass the scan's own as --spacing-mm"):
        load(path)
    loaded = load(path, spacing_m=(2.5e-3,) * 3)
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.055**3, rel=0.02)


def test_a_volume_that_memory_cannot_hold_is_refused_before_it_is_read(tmp_path):
    path = default_file(tmp_path, "seg.nii")
    content = bytearray(path.read_bytes())
    content[42:48] = np.array([30_000] * 3, dtype="<i2").tobytes()  # dim[1..3]: 27 million million voxels
    path.write_bytes(bytes(content))
    with pytest.raises(WorldError, match=r"30000 x 30000 x 30000 voxels take .* GiB.*crop it"):
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
    n_refused, start_s = 0, time.monotonic()
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
    assert time.monotonic() - start_s < 120.0  # not a speed: a hang

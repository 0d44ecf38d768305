"""Label volumes: what a segmentation holds comes out in the right place and size."""

from typing import get_args

import nrrd
import numpy as np
import pytest
import SimpleITK
from hypothesis import given, settings
from hypothesis import strategies as st
from scanned_ball import CENTRE_MM, assert_is_the_ball, ball_labels, grid, load, save_nifti
from scipy.spatial.transform import Rotation

from sim.world.errors import WorldError
from sim.world.volumes.files import load_volume
from sim.world.volumes.label_coding import CODINGS, CodingName, LabelChoice


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


@settings(max_examples=8)
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
        assert np.array_equal(volume.labels, labels[volume.box])
        assert volume.labels.astype(bool).sum() == (labels > 0).sum()
        assert volume.scan_shape == labels.shape
        # NIfTI keeps its affine in single precision.
        assert (volume.T_lps_voxel @ [*corner, 1.0])[:3] == pytest.approx(expected_m, abs=2e-6)


@pytest.mark.parametrize(
    ("encoding", "space"),
    [
        ("raw", "left-posterior-superior"),
        ("gzip", "right-anterior-superior"),
        ("bzip2", "right-anterior-superior"),
    ],
)
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


def test_every_coding_has_a_name_that_can_be_given():
    assert get_args(CodingName) == ("auto", *CODINGS)


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
    assert any("1 tumour piece outside the organ was dropped" in notice for notice in loaded.notices)


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
    assert any("pass the scan's own spacing as `spacing_mm`" in notice for notice in loaded.notices)
    spaced = load(path, spacing_m=(2.5e-3,) * 3)
    assert spaced.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.055**3, rel=0.02)


def test_probabilities_are_cut_at_one_half_and_said_so(tmp_path):
    T, shape = grid()
    soft = np.clip((ball_labels(T, shape) > 0) * 0.8 + 0.1, 0, 1).astype(np.float32)
    soft[0, 0, 0] = np.nan
    loaded = load(save_nifti(tmp_path / "soft.nii.gz", soft, T))
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.055**3, rel=0.02)
    assert any("above 0.5 are taken for label 1" in notice for notice in loaded.notices)
    assert any("a voxel is NaN" in notice for notice in loaded.notices)

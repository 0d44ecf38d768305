"""Where a volume lies by each tool: headers with two answers or none are told, and maps carry a single one."""

import itertools

import nibabel
import numpy as np
import pytest
import SimpleITK
from scanned_ball import ball_labels, default_file, grid, load, save_nifti
from scipy.spatial.transform import Rotation

from sim.record.map_volumes import MapArrays, map_volumes
from sim.world.anatomy.placement import turned
from sim.world.volumes.files import load_volume
from sim.world.volumes.nifti_places import itk_affine

RAS = np.array([-1.0, -1.0, 1.0])


def with_forms(path, sform, s_code, qform, q_code, labels=None, unit="mm"):
    """A file whose sform and qform are set one by one [mm, RAS]."""
    image = nibabel.Nifti1Image(np.ones((5, 6, 7), np.uint8) if labels is None else labels, None)
    scale = np.diag([1e-3, 1e-3, 1e-3, 1.0]) if unit == "meter" else np.eye(4)
    image.header.set_qform(scale @ qform, q_code)
    image.header.set_sform(scale @ sform if s_code else None, s_code)
    image.header.set_xyzt_units(unit)
    nibabel.save(image, path)
    return path


def base():
    T = np.diag([2.0, 2.0, 3.0, 1.0])
    T[:3, 3] = [-30.0, -20.0, 10.0]
    return T


def changed(kind):
    """The base's map with something else about it."""
    T = base()
    if kind == "mirrored":
        T[0] *= -1.0
    elif kind == "shifted":
        T[1, 3] += 1.0
    elif kind == "turned":
        T[:3, :3] = Rotation.from_rotvec([0.0, 0.0, 0.3]).as_matrix() @ T[:3, :3]
    elif kind == "coarser":
        T[:3, :3] *= 1.5
    elif kind == "sheared":
        T[0, 1] = 0.5
    return T


KINDS = ("the same", "mirrored", "shifted", "turned", "coarser", "sheared")


@pytest.mark.parametrize("kind", KINDS)
def test_what_itk_makes_of_a_header_is_known(tmp_path, kind):
    for number, (s_code, q_code) in enumerate(itertools.product((0, 1, 2, 4), (0, 1, 2))):
        path = with_forms(tmp_path / f"{number}.nii", changed(kind), s_code, base(), q_code)
        T = itk_affine(nibabel.load(path).header)
        try:
            image = SimpleITK.ReadImage(str(path))
        except RuntimeError:
            assert kind == "sheared"
            assert T is None
            continue
        for index in ((0, 0, 0), (4, 5, 6)):  # in single precision
            place = np.array(image.TransformIndexToPhysicalPoint(index)) * RAS
            assert (T @ [*index, 1.0])[:3] == pytest.approx(place, abs=1e-4)


@pytest.mark.parametrize("codes", [(2, 1), (1, 1), (4, 2)])
def test_two_answers_are_told_with_both_places_and_who_follows_which(tmp_path, codes):
    T, shape = grid()
    sform = np.diag([*RAS, 1.0]) @ T
    qform = sform.copy()
    qform[0] *= -1.0
    path = with_forms(tmp_path / "seg.nii.gz", sform, codes[0], qform, codes[1], ball_labels(T, shape))
    loaded = load(path)
    # nibabel's answer is the one that is followed.
    assert loaded.organ.bounds_m.mean(axis=0) * 1e3 == pytest.approx([-60.0, -20.0, 40.0], abs=0.4)
    (notice,) = [text for text in loaded.notices if "two answers" in text]
    assert f"by the sform (code {codes[0]}) its middle lies at LPS -60.0 -20.0 40.0 mm" in notice
    assert f"by the qform (code {codes[1]}) its middle lies at LPS 60.0 -20.0 40.0 mm" in notice
    assert "mirror image" in notice
    itk = SimpleITK.ReadImage(str(path))
    middle_mm = itk.TransformContinuousIndexToPhysicalPoint([(n - 1) / 2 for n in shape])
    follows = "follow it too" if middle_mm[0] < 0.0 else "ITK and 3D Slicer follow the qform"
    assert follows in notice
    assert notice.endswith(("set_sform and set_qform)",))


@pytest.mark.parametrize("unit", ["mm", "meter"])
@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("mirrored", "mirror image"),
        ("shifted", "up to 1 mm apart"),
        ("turned", "turned by 17.2 degrees"),
        ("coarser", "with voxels of 2 x 2 x 3 mm in place of 3 x 3 x 4.5 mm"),
    ],
)
def test_each_kind_of_difference_is_named(tmp_path, kind, said, unit):
    path = with_forms(tmp_path / "seg.nii", changed(kind), 2, base(), 1, unit=unit)
    assert any(said in text for text in load_volume(path).notices)


def test_forms_that_agree_or_of_which_one_is_set_need_no_word(tmp_path):
    rounded = base()
    rounded[:3, 3] += 0.01  # what single precision may do
    for number, (form, s_code, q_code) in enumerate(
        [(base(), 1, 1), (base(), 2, 1), (base(), 2, 0), (changed("turned"), 0, 1), (rounded, 2, 1)]
    ):
        path = with_forms(tmp_path / f"{number}.nii", form, s_code, base(), q_code)
        assert not load_volume(path).notices
    assert not load_volume(default_file(tmp_path)).notices


def test_spacings_that_contradict_the_sform_are_told(tmp_path):
    (notice,) = load_volume(with_forms(tmp_path / "s.nii", changed("coarser"), 2, base(), 0)).notices
    assert "contradict its sform" in notice
    assert "off it in ITK and 3D Slicer" in notice


def test_without_a_code_both_places_are_told(tmp_path):
    T, shape = grid()
    path = tmp_path / "seg.nii.gz"
    with_forms(path, np.eye(4), 0, np.diag([3.0, 3.0, 3.0, 1.0]), 0, ball_labels(T, shape))
    _, notice = (text for text in load_volume(path).notices if "patient axes" in text)
    image = SimpleITK.ReadImage(str(path))
    middle_mm = image.TransformContinuousIndexToPhysicalPoint([(n - 1) / 2 for n in shape])
    here, there = notice.split("in ITK and 3D Slicer its middle", maxsplit=1)
    assert "its middle lies at LPS 0.0 0.0 0.0 mm" in here
    assert f"lies at LPS {' '.join(f'{each:.1f}' for each in middle_mm)} mm" in there


@pytest.mark.parametrize("centering", ["", "centerings: cell cell cell\n", "centerings: node node node\n"])
def test_an_nrrd_file_without_a_space_lies_where_itk_has_it(tmp_path, centering):
    lines = "NRRD0005\ntype: uchar\ndimension: 3\nsizes: 5 6 7\nencoding: raw\nspacings: 2 2 3\n"
    header = f"{lines}axis mins: 10 20 30\n{centering}\n"
    path = tmp_path / "seg.nrrd"
    path.write_bytes(header.encode() + bytes([1] * 210))
    volume = load_volume(path)
    image = SimpleITK.ReadImage(str(path))
    place_mm = image.TransformIndexToPhysicalPoint((4, 5, 6))
    assert (volume.T_lps_voxel @ [4, 5, 6, 1.0])[:3] * 1e3 == pytest.approx(place_mm, abs=1e-6)
    assert any("as in ITK and 3D Slicer" in text for text in volume.notices)


@pytest.mark.parametrize("turn_deg", [(0, 0, 0), (90, 0, 0), (20, -15, 70), (179, 1, 0.01), (0.01, 180, 0)])
def test_a_map_has_one_place_in_every_tool(tmp_path, turn_deg):
    axis_m, T = np.arange(8) * 0.03, np.eye(4)
    T[:3, :3], T[:3, 3] = turned(np.deg2rad(turn_deg)), [0.4, -0.1, 0.2]
    field = np.full((8, 8, 8), 0.5)
    arrays = MapArrays(
        axes_m=(axis_m,) * 3, probability=field, latent_variance=field, is_inside=np.ones((8, 8, 8), bool)
    )
    for name, content in map_volumes(arrays, T).items():
        path = tmp_path / name
        path.write_bytes(content)
        header = nibabel.load(path).header
        assert int(header["sform_code"]) == int(header["qform_code"]) == 1
        corner = [7, 7, 7, 1.0]
        expected_mm = (np.linalg.inv(T) @ [axis_m[-1], axis_m[-1], axis_m[-1], 1.0])[:3] * 1e3
        assert (header.get_sform() @ corner)[:3] * RAS == pytest.approx(expected_mm, abs=1e-4)
        # The qform's quaternion is kept in single precision, which near half a turn leaves 0.02 degrees.
        assert (header.get_qform() @ corner)[:3] * RAS == pytest.approx(expected_mm, abs=0.1)
        image = SimpleITK.ReadImage(str(path))
        assert image.TransformIndexToPhysicalPoint((7, 7, 7)) == pytest.approx(expected_mm, abs=1e-4)


def test_a_case_read_by_its_sform_and_written_again_needs_no_word(tmp_path):
    T, shape = grid()
    sform = np.diag([*RAS, 1.0]) @ T
    path = save_nifti(tmp_path / "seg.nii.gz", ball_labels(T, shape), T)
    image = nibabel.load(path)
    image.set_qform(np.diag([-1.0, 1.0, 1.0, 1.0]) @ sform, 1)
    nibabel.save(image, path)
    assert load_volume(path).notices
    image.set_qform(image.get_sform(), 1)
    nibabel.save(image, path)
    assert not load_volume(path).notices

"""Labels without a word of the user: names in the header come first, guesses are checked and always said."""

import json

import nibabel
import numpy as np
import pytest
from scanned_ball import CENTRE_MM, assert_is_the_ball, ball_labels, grid, load, save_nifti

from sim.world.errors import VolumeError
from sim.world.volumes.files import load_volume
from sim.world.volumes.label_coding import LabelChoice


def with_extension(path, labels, T, content, code=0):
    save_nifti(path, labels, T)
    image = nibabel.load(path)
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension(code, content))
    nibabel.save(nibabel.Nifti1Image(labels, image.affine, image.header), path)
    return path


def label_table(names):
    """What TotalSegmentator and Connectome Workbench write."""
    rows = "".join(
        f'<Label Key="{key}" Red="1" Alpha="1"><![CDATA[{name}]]></Label>\n' for key, name in names.items()
    )
    head = '<?xml version="1.0" encoding="UTF-8"?> <CaretExtension><VolumeInformation Index="0"><LabelTable>'
    return f"{head}{rows}</LabelTable></VolumeInformation></CaretExtension>".encode()


EXTENSIONS = {
    "XML": (0, label_table),
    "Workbench": (30, label_table),
    "JSON by number": (
        6,
        lambda names: json.dumps({"labels": {str(k): v for k, v in names.items()}}).encode(),
    ),
    "JSON by name": (0, lambda names: json.dumps({"labels": {v: k for k, v in names.items()}}).encode()),
    "JSON list": (0, lambda names: json.dumps([{"name": v, "value": k} for k, v in names.items()]).encode()),
    "AFNI": (
        4,
        lambda names: (
            '<AFNI_attributes><AFNI_atr ni_type="String" atr_name="VALUE_LABEL_DTABLE">"<VALUE_LABEL_DTABLE\n'
            + "\n".join(f'"{k}" "{v}"' for k, v in names.items())
            + '\n</VALUE_LABEL_DTABLE>"</AFNI_atr></AFNI_attributes>'
        ).encode(),
    ),
}


@pytest.mark.parametrize("kind", EXTENSIONS)
def test_names_in_the_headers_extension_are_obeyed(tmp_path, kind):
    code, write = EXTENSIONS[kind]
    T, shape = grid()
    labels = np.choose(ball_labels(T, shape), [0, 7, 9]).astype(np.uint8)
    labels[:5, :5, :5] = 5  # TotalSegmentator's liver by its number
    path = with_extension(
        tmp_path / "seg.nii.gz", labels, T, write({7: "liver", 9: "Läsion", 5: "colon"}), code
    )
    assert load_volume(path).label_names == {7: "liver", 9: "Läsion", 5: "colon"}
    loaded = load(path)
    assert_is_the_ball(loaded)
    assert [structure.name for structure in loaded.structures] == ["colon"]


def test_extensions_that_name_nothing_do_no_harm(tmp_path):
    T, shape = grid()
    for number, content in enumerate(
        [b"", b"\x00\xff\xfe" * 50, b"[" * 5000, b'{"a": [1, 2]}', b"<Label Key='x'></Label>"]
    ):
        path = with_extension(tmp_path / f"{number}.nii", ball_labels(T, shape), T, content)
        assert load_volume(path).label_names == {}
        assert_is_the_ball(load(path))


def test_vessels_and_tumours_by_name_are_no_liver_and_tumour(tmp_path):
    T, shape = grid()
    names = label_table({1: "liver_vessels", 2: "liver_tumor"})
    path = with_extension(tmp_path / "seg.nii.gz", ball_labels(T, shape), T, names)
    with pytest.raises(
        VolumeError, match=r"which of its labels is the organ\? It holds 1 'liver_vessels'.*tell none"
    ):
        load(path)
    loaded = load(path, labels=LabelChoice(coding="lits"))
    assert any("the organ is 1 'liver_vessels', which has the name of a vessel" in n for n in loaded.notices)


def tree(T, shape):
    """A tree of tubes: crosses of radius 4 mm in the three planes."""
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    off_mm = np.abs(index @ T[:3, :3].T + T[:3, 3] - CENTRE_MM)
    return ((off_mm < 4.0).sum(axis=-1) >= 2) & (off_mm.max(axis=-1) < 60.0)


def test_a_tree_of_vessels_is_not_guessed_to_be_an_organ(tmp_path):
    T, shape = grid()
    labels = tree(T, shape).astype(np.uint8)
    notices = load(save_nifti(tmp_path / "one.nii.gz", labels, T)).notices
    assert any("its one label, 1, is taken for the organ" in notice for notice in notices)
    assert any("as a tree of vessels does" in notice for notice in notices)
    labels[ball_labels(T, shape) == 2] = 2
    path = save_nifti(tmp_path / "two.nii.gz", labels, T)
    with pytest.raises(
        VolumeError, match=r"LiTS's liver and tumour, but they fill \d+% .*`coding` lits takes them"
    ):
        load(path)
    assert load(path, labels=LabelChoice(coding="lits")).tumours


def test_labels_in_the_other_order_are_not_guessed(tmp_path):
    T, shape = grid()
    labels = np.choose(ball_labels(T, shape), [0, 2, 1]).astype(np.uint8)
    with pytest.raises(VolumeError, match="label 2 is larger than label 1"):
        load(save_nifti(tmp_path / "seg.nii.gz", labels, T))


def test_a_guess_is_always_said(tmp_path):
    T, shape = grid()
    labels = ball_labels(T, shape)
    (notice,) = load(save_nifti(tmp_path / "two.nii.gz", labels, T)).notices
    assert "its labels are taken for LiTS's: 1 is the organ, 2 its tumours" in notice


def whole_body(numbers):
    """A liver as label 5 and a gallbladder as 4, with a cava and a rib under the numbers given, and more by others."""
    T, shape = grid(half_mm=90.0)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    off_mm = index @ T[:3, :3].T + T[:3, 3] - CENTRE_MM
    labels = np.where(ball_labels(T, shape) > 0, 5, 0).astype(np.uint8)
    labels[np.linalg.norm(off_mm - [0.0, -58.0, 0.0], axis=-1) < 12.0] = 4
    labels[(np.linalg.norm(off_mm[..., :2] - [0.0, 60.0], axis=-1) < 11.0) & (labels == 0)] = numbers["cava"]
    is_rib = (np.abs(off_mm[..., 0] + 70.0) < 7.0) & (np.abs(off_mm[..., 2]) < 8.0)
    labels[is_rib & (np.abs(off_mm[..., 1]) < 60.0)] = numbers["rib"]
    labels[:3, :3, :3] = numbers["other"]
    return labels, T


@pytest.mark.parametrize(
    ("numbers", "cava", "said"),
    [
        ({"cava": 63, "rib": 93, "other": 20}, 63, "of version 2"),
        ({"cava": 8, "rib": 63, "other": 20}, 8, "of version 1"),
        ({"cava": 30, "rib": 63, "other": 8}, None, "of which version cannot be told"),
        ({"cava": 63, "rib": 93, "other": 115}, 63, "of version 2"),
    ],
)
def test_the_version_of_totalsegmentator_is_told_by_what_looks_like_a_cava(tmp_path, numbers, cava, said):
    labels, T = whole_body(numbers)
    loaded = load(save_nifti(tmp_path / "seg.nii.gz", labels, T))
    names = [structure.name for structure in loaded.structures]
    assert names == (["gallbladder", "inferior vena cava"] if cava else ["gallbladder"])
    assert any(said in notice and "5 is the liver" in notice for notice in loaded.notices)
    assert any("taken for nothing" in notice for notice in loaded.notices)


def test_a_coding_of_the_other_version_is_remarked_on(tmp_path):
    labels, T = whole_body({"cava": 8, "rib": 63, "other": 20})
    path = save_nifti(tmp_path / "seg.nii.gz", labels, T)
    loaded = load(path, labels=LabelChoice(coding="totalsegmentator"))
    assert any(
        "label 63 is the inferior vena cava in this coding and does not look" in n for n in loaded.notices
    )
    right = load(path, labels=LabelChoice(coding="totalsegmentator-v1"))
    assert not any("does not look" in notice for notice in right.notices)
    assert [structure.name for structure in right.structures] == ["gallbladder", "inferior vena cava"]


def test_a_spleen_that_is_larger_than_the_liver_is_no_guess(tmp_path):
    labels, T = whole_body({"cava": 63, "rib": 93, "other": 20})
    labels = np.choose(labels == 5, [np.where(labels == 63, 5, labels), 1]).astype(np.uint8)
    labels[:40, :40, :12] = 5
    with pytest.raises(VolumeError, match="label 5 would be TotalSegmentator's liver, but label 1 is larger"):
        load(save_nifti(tmp_path / "seg.nii.gz", labels, T))

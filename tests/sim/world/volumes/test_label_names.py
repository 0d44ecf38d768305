"""Names in a file: decoded as people wrote them, obeyed, and never passed over in silence."""

import numpy as np
import pytest
from scanned_ball import assert_is_the_ball, ball_labels, grid, load

from sim.world.errors import WorldError
from sim.world.volumes.files import load_volume
from sim.world.volumes.label_coding import LabelChoice


def save_segments(path, names, *, values=None, encoding="utf-8", labels=None, start=b""):
    """A file as 3D Slicer writes it: the ball and its tumour, whose segments have these names, and a third beside."""
    T, shape = grid()
    if labels is None:
        labels = ball_labels(T, shape)
        labels[:4, :4, :4] = 3
    columns = " ".join(f"({','.join(str(x) for x in column)})" for column in T[:3, :3].T)
    lines = [
        *("NRRD0005", "type: uchar", "dimension: 3", "space: left-posterior-superior"),
        f"sizes: {' '.join(map(str, shape))}",
        f"space directions: {columns}",
        *("encoding: raw", f"space origin: ({','.join(str(x) for x in T[:3, 3])})"),
    ]
    for index, name in enumerate(names):
        lines += [
            f"Segment{index}_Name:={name}",
            f"Segment{index}_LabelValue:={(values or (1, 2, 3))[index]}",
        ]
    content = "\n".join([*lines, "", ""]).encode(encoding) + labels.tobytes(order="F")
    path.write_bytes(start + content)
    return path


@pytest.mark.parametrize(
    "names",
    [
        ("Leber", "Läsion", "Gefäße"),
        ("foie", "lésion", "veine"),
        ("печень", "опухоль", "сосуд"),
        ("肝臓", "腫瘍", "門脈"),
        ("간", "종양", "문맥"),
        ("karaciğer", "tümör", "damar"),
    ],
    ids=str,
)
def test_names_in_any_script_tell_organ_and_tumours_and_are_kept(tmp_path, names):
    loaded = load(save_segments(tmp_path / "case.seg.nrrd", names))
    assert_is_the_ball(loaded)
    assert [structure.name for structure in loaded.structures] == [names[2]]
    (notice,) = loaded.notices
    assert notice == (
        f"case.seg.nrrd: by the labels' names 1 {names[0]!r} is taken for the organ, 2 {names[1]!r} for tumours and "
        f"3 {names[2]!r} for structures to show"
    )


def test_names_that_are_no_utf_8_and_a_mark_before_the_header_are_read(tmp_path):
    path = save_segments(tmp_path / "old.seg.nrrd", ("Leber", "Läsion", "Gefäße"), encoding="cp1252")
    assert_is_the_ball(load(path))
    path = save_segments(tmp_path / "mark.seg.nrrd", ("Leber", "Läsion", "Gefäße"), start=b"\xef\xbb\xbf")
    assert load_volume(path).label_names[2] == "Läsion"


def test_a_line_break_and_a_backslash_in_a_name_are_unescaped(tmp_path):
    path = save_segments(tmp_path / "odd.seg.nrrd", ("liver", r"tumor\nleft", r"a\\b"))
    assert load_volume(path).label_names == {1: "liver", 2: "tumor left", 3: "a\\b"}


def test_two_structures_of_one_name_are_both_kept(tmp_path):
    loaded = load(save_segments(tmp_path / "case.seg.nrrd", ("vessel", "vessel", "liver"), values=(2, 3, 1)))
    assert len(loaded.structures) == 2
    assert loaded.structures[0].name != loaded.structures[1].name


def test_no_tumour_among_the_names_is_said(tmp_path):
    loaded = load(save_segments(tmp_path / "case.seg.nrrd", ("Leber", "Lokalbefund", "Gefäße")))
    assert not loaded.tumours
    assert any("none for a tumour" in notice and "'Lokalbefund'" in notice for notice in loaded.notices)


def test_a_tumour_that_is_named_and_not_there_is_said(tmp_path):
    T, shape = grid()
    labels = np.minimum(ball_labels(T, shape), 1)
    path = save_segments(tmp_path / "case.seg.nrrd", ("Leber", "Läsion", "vessel"), labels=labels)
    assert any("names 2 'Läsion', but no voxel" in notice for notice in load(path).notices)


def test_labels_that_are_taken_for_nothing_are_said(tmp_path):
    path = save_segments(tmp_path / "case.seg.nrrd", ("Leber", "Läsion", "Gefäße"))
    loaded = load(path, labels=LabelChoice(organ=(1,)))
    assert any("2 'Läsion' has a tumour's name" in n and "pass `tumour_label` 2" in n for n in loaded.notices)
    assert any("the label 3 'Gefäße' is taken for nothing" in notice for notice in loaded.notices)


def test_names_that_tell_no_organ_are_not_overruled_by_numbers(tmp_path):
    T, shape = grid()
    path = save_segments(tmp_path / "a.seg.nrrd", ("vessels", "tumors"), labels=ball_labels(T, shape))
    with pytest.raises(WorldError, match=r"It holds 1 'vessels' .*their names tell none.*`organ_label`"):
        load(path)
    path = save_segments(tmp_path / "b.seg.nrrd", ("Segment_1", "Segment_2"), labels=ball_labels(T, shape))
    assert_is_the_ball(load(path))
    path = save_segments(tmp_path / "c.seg.nrrd", ("Niere", "Tumor"), labels=ball_labels(T, shape))
    assert_is_the_ball(load(path))

"""Files that hold no arm: each is told in one line."""

from __future__ import annotations

import re

import pytest
from arm_files import ARM, FLANGE

from sim.world.scene.arm import ArmError, ArmModel


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("arm.xml", b"", "empty file"),
        ("arm.xml", b"\x1f\x8b\x08\x00\x00", "XML parse error"),
        ("arm.xml", "<mujoco><worldbody/></mujoco>".encode("utf-16"), "XML parse error"),
        ("arm.xml", b"<mujoco><worldbody>" + 900 * b"<body>" + b"</worldbody></mujoco>", "XML parse error"),
        ("arm.xml", b"<sdf version='1.6'/>", "Unrecognized XML model type: 'sdf'"),
        ("arm.mjcf", b"<mujoco/>", "tells files by their names, and reads arms from .xml and .urdf"),
        ("arm", b"<mujoco/>", "tells files by their names"),
    ],
)
def test_a_file_that_is_no_mjcf_is_told_in_one_line(tmp_path, name, content, words) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ArmError, match=re.escape(words)) as caught:
        ArmModel(path=tmp_path / name).load()
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path) -> None:
    text = ARM.format(head="", world="", roll='range="-170 170"', flange=FLANGE, extra="")
    (tmp_path / "arm.xml").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert len(ArmModel(path=tmp_path / "arm.xml").load().home_q) == 6


def test_a_name_too_long_for_a_file_is_a_missing_file(tmp_path) -> None:
    with pytest.raises(ArmError, match="no such arm file"):
        ArmModel(path=tmp_path / (5000 * "x")).load()


def test_a_folder_is_no_missing_file(tmp_path) -> None:
    with pytest.raises(ArmError, match="this is a folder.*`arm`"):
        ArmModel(path=tmp_path).load()

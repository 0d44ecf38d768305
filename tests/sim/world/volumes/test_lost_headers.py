"""Headers that were lost, as of LiTS 28-47: told by their signature, and mended by what the user knows."""

import numpy as np
import pytest
from scanned_ball import default_file, load, save_nifti

from sim.world.errors import VolumeError
from sim.world.volumes.files import load_volume

IDENTITY = np.diag([-1.0, -1.0, 1.0, 1.0])
"""RAS, as a lost header says it [LPS]."""


def liver_mm(points_mm):
    """A crude liver in LPS: a large right lobe, a small left one, and a dome."""
    right = np.linalg.norm((points_mm - [-40.0, 0.0, 15.0]) / [60.0, 75.0, 62.0], axis=-1) < 1.0
    left = np.linalg.norm((points_mm - [45.0, -15.0, 25.0]) / [55.0, 40.0, 35.0], axis=-1) < 1.0
    low = np.linalg.norm((points_mm - [-55.0, 0.0, -55.0]) / [35.0, 40.0, 25.0], axis=-1) < 1.0
    return right | left | low


def scan(spacing_mm, axes=(1, 1, 1), shape=(512, 512)):
    """Labels of the liver on a scan's grid of that spacing, whose axes run to the left, back and head, or against."""
    n = np.array([*shape, int(200 / spacing_mm[2])])
    ticks = [(np.arange(k) - (k - 1) / 2) * s * d for k, s, d in zip(n, spacing_mm, axes, strict=True)]
    labels = np.zeros(n, np.uint8)
    inside = [np.flatnonzero(np.abs(t) < 110.0) for t in ticks]
    points_mm = np.stack(
        np.meshgrid(*[t[i] for t, i in zip(ticks, inside, strict=True)], indexing="ij"), axis=-1
    )
    labels[np.ix_(*inside)] = liver_mm(points_mm)
    return labels


LETTERS = {(1, 1, 1): "LPS", (-1, 1, 1): "RPS", (1, 1, -1): "LPI", (-1, -1, -1): "RAI"}


@pytest.mark.parametrize("spacing_mm", [(0.7, 0.7, 5.0), (0.98, 0.98, 2.5)], ids=str)
@pytest.mark.parametrize("axes", LETTERS)
def test_a_lost_header_is_told_with_spacing_and_axes(tmp_path, spacing_mm, axes):
    path = save_nifti(tmp_path / "segmentation-30.nii", scan(spacing_mm, axes), IDENTITY)
    (notice,) = [text for text in load(path).notices if "lost header" in text]
    assert "`spacing_mm` X Y Z" in notice
    assert "`voxel_axes`" in notice
    letters = LETTERS[axes]  # front and back cannot be told by the shape
    assert f"{letters[0]}P{letters[2]} or {letters[0]}A{letters[2]}" in notice


def test_what_the_user_knows_mends_it(tmp_path):
    labels, spacing_m = scan((0.8, 0.8, 4.0), (-1, 1, -1)), (0.8e-3, 0.8e-3, 4e-3)
    path = save_nifti(tmp_path / "seg.nii", labels, IDENTITY)
    spaced = load(path, spacing_m=spacing_m)
    assert any("its axes are probably lost as well" in n and "RPI or RAI" in n for n in spaced.notices)
    whole = load(path, spacing_m=spacing_m, voxel_axes="rpi")
    assert not any("lost" in notice for notice in whole.notices)
    # The same as a scan whose header was never lost.
    expected = load_volume(save_nifti(tmp_path / "right.nii", labels, np.diag([-0.8, 0.8, -4.0, 1.0])))
    volume = load_volume(path, spacing_m=spacing_m, axes="RPI")
    assert volume.orientation == "RPI"
    # NIfTI keeps its affine in single precision.
    assert volume.T_lps_voxel[:3, :3] == pytest.approx(expected.T_lps_voxel[:3, :3], abs=1e-9)


def test_a_scan_of_1_mm_that_can_be_one_needs_no_word(tmp_path):
    labels = scan((1.0, 1.0, 1.0), shape=(300, 280))
    path = save_nifti(tmp_path / "seg.nii", labels, np.diag([1.0, 1.0, 1.0, 1.0]))
    assert not any("lost" in notice for notice in load(path).notices)


@pytest.mark.parametrize("axes", ["LP", "LPX", "LRS", "LPSA", ""])
def test_axes_that_are_none_are_refused(tmp_path, axes):
    with pytest.raises(VolumeError, match=r"`voxel_axes` .*three letters"):
        load(default_file(tmp_path), voxel_axes=axes)

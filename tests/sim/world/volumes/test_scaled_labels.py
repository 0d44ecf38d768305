"""Labels that are stored with a slope and an intercept: what the file means comes out, whatever its steps."""

import nibabel
import numpy as np
import pytest
from scanned_ball import assert_is_the_ball, ball_labels, grid, load, save_nifti

from sim.world.errors import VolumeError
from sim.world.volumes.files import load_volume


def saved_under(path, values, T, dtype):
    """Floating-point labels saved under the header of a scan of another type, which nibabel scales to fit."""
    header = nibabel.Nifti1Header()
    header.set_data_dtype(dtype)
    nibabel.save(
        nibabel.Nifti1Image(values.astype(np.float64), np.diag([-1.0, -1.0, 1.0, 1.0]) @ T, header), path
    )
    image = nibabel.load(path)
    assert image.dataobj.slope != 1.0
    return path


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint16, np.int32])
@pytest.mark.parametrize("most", [2, 3, 40, 117])
def test_labels_saved_under_a_scans_header_come_back(tmp_path, dtype, most):
    T, shape = grid((6.0, 6.0, 6.0))
    labels = ball_labels(T, shape)
    labels[:2, :2, :2] = most
    volume = load_volume(saved_under(tmp_path / "seg.nii.gz", labels, T, dtype))
    assert np.array_equal(volume.labels, labels[volume.box])
    assert volume.notices == ()


def test_an_organ_and_its_tumour_are_the_same_with_a_slope(tmp_path):
    T, shape = grid()
    assert_is_the_ball(load(saved_under(tmp_path / "seg.nii", ball_labels(T, shape), T, np.uint8)))


def test_probabilities_in_steps_of_a_slope_are_cut_at_one_half(tmp_path):
    T, shape = grid()
    soft = np.clip((ball_labels(T, shape) > 0) * 0.8 + 0.1, 0.0, 1.0)
    loaded = load(saved_under(tmp_path / "soft.nii.gz", soft, T, np.uint8))
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.055**3, rel=0.02)
    assert any("above 0.5 are taken for label 1" in notice for notice in loaded.notices)


@pytest.mark.parametrize(("slope", "intercept"), [(1.0, -1024.0), (0.5, 0.0), (2.5, 0.3)])
def test_a_slope_that_is_left_over_from_the_scan_is_told_and_left_aside(tmp_path, slope, intercept):
    T, shape = grid()
    path = tmp_path / "seg.nii"
    save_nifti(path, ball_labels(T, shape), T)
    content = bytearray(path.read_bytes())
    content[112:120] = np.array([slope, intercept], dtype="<f4").tobytes()  # scl_slope, scl_inter
    path.write_bytes(bytes(content))
    loaded = load(path)
    assert_is_the_ball(loaded)
    assert any(
        f"a slope of {slope:g}" in notice and "left over from the scan" in notice for notice in loaded.notices
    )


def test_a_scan_with_a_slope_is_still_no_segmentation(tmp_path):
    T, shape = grid((6.0, 6.0, 6.0))
    rng = np.random.default_rng(0)
    scan = rng.normal(40.0, 300.0, shape)
    for dtype in (np.uint8, np.int16):
        with pytest.raises(VolumeError, match="looks like the scan itself"):
            load_volume(saved_under(tmp_path / "ct.nii.gz", scan, T, dtype))


def test_values_that_came_back_from_a_slope_and_were_saved_again_are_labels(tmp_path):
    T, shape = grid()
    off = ball_labels(T, shape).astype(np.float32) * np.float32(127 * 2 / 255)  # 0.996 and 1.992
    loaded = load(save_nifti(tmp_path / "seg.nii.gz", off, T))
    assert_is_the_ball(loaded)
    assert any("up to 0.0078 off whole numbers, to which they were rounded" in n for n in loaded.notices)

"""A ball with a tumour in it as a label volume, on any grid."""

import nibabel
import numpy as np
import pytest

from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.loading import load_anatomy

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
    return load_anatomy(CaseFiles(organ=str(path), **options))


def assert_is_the_ball(loaded, *, rel=0.02, abs_mm=0.4):
    # Voxels of 3 mm count a ball of 55 mm within a hundredth.
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * (RADIUS_MM * 1e-3) ** 3, rel=rel)
    assert loaded.organ.bounds_m.mean(axis=0) * 1e3 == pytest.approx(CENTRE_MM, abs=abs_mm)
    (tumour,) = loaded.tumours
    assert tumour.volume_m3 == pytest.approx(4 / 3 * np.pi * (TUMOUR_RADIUS_MM * 1e-3) ** 3, rel=0.08)
    middle_m = tumour.sample_inside(4000, np.random.default_rng(0)).mean(axis=0)
    assert middle_m * 1e3 == pytest.approx(TUMOUR_MM, abs=2 * abs_mm)

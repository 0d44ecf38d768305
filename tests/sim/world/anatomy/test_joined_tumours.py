"""Outlines that leave the tumour out: a tumour beside its organ joins it, and one elsewhere does not."""

import numpy as np
import pytest
import trimesh
from scanned_ball import CENTRE_MM, RADIUS_MM, TUMOUR_RADIUS_MM, grid, load, save_nifti

from sim.world.anatomy.anatomy import build_anatomy
from sim.world.errors import AnatomyError

BALL_M3 = 4 / 3 * np.pi * (RADIUS_MM * 1e-3) ** 3
TUMOUR_M3 = 4 / 3 * np.pi * (TUMOUR_RADIUS_MM * 1e-3) ** 3


def masks(offset_mm, spacing_mm=(3.0, 3.0, 3.0)):
    """A ball and a smaller one at an offset from its middle, as masks, and the ball's mask without the other."""
    T, shape = grid(spacing_mm, half_mm=75.0)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    off_mm = index @ T[:3, :3].T + T[:3, 3] - CENTRE_MM
    ball = np.linalg.norm(off_mm, axis=-1) < RADIUS_MM
    tumour = np.linalg.norm(off_mm - offset_mm, axis=-1) < TUMOUR_RADIUS_MM
    return T, (ball & ~tumour).astype(np.uint8), tumour.astype(np.uint8), int((ball | tumour).sum())


@pytest.mark.parametrize("offset_mm", [(0.0, -47.0, 0.0), (30.0, 30.0, 30.0), (0.0, 0.0, 62.0)], ids=str)
@pytest.mark.parametrize("spacing_mm", [(3.0, 3.0, 3.0), (1.5, 1.5, 5.0)], ids=str)
def test_a_tumour_that_the_mask_leaves_out_joins_the_organ(tmp_path, offset_mm, spacing_mm):
    # At its rim, cut out of it; and on it, with half a millimetre of it inside.
    T, organ, tumour, n_voxels = masks(offset_mm, spacing_mm)
    liver = save_nifti(tmp_path / "liver.nii.gz", organ, T)
    nodule = save_nifti(tmp_path / "nodule.nii.gz", tumour, T)
    loaded = load(liver, tumours=(str(nodule),))
    assert loaded.organ.volume_m3 == pytest.approx(n_voxels * np.prod(spacing_mm) * 1e-9, rel=0.02)
    assert loaded.organ.to_trimesh().is_watertight
    assert len(loaded.organ.to_trimesh().split()) == 1  # no gap is left between the two
    (held,) = loaded.tumours
    points_m = held.sample_inside(2000, np.random.default_rng(0))
    assert loaded.organ.contains(points_m).mean() > 0.95
    assert any("nodule.nii.gz: the organ's outline leaves this tumour out" in n for n in loaded.notices)
    build_anatomy(loaded.organ, loaded.tumours, name="x", rng=np.random.default_rng(0))


def test_meshes_are_joined_as_volumes_are(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS_MM)
    hole = trimesh.creation.icosphere(subdivisions=3, radius=TUMOUR_RADIUS_MM)
    hole.apply_translation([20.0, 0.0, 0.0])
    hole.export(tmp_path / "tumour.stl")
    hole.invert()
    trimesh.util.concatenate([ball, hole]).export(tmp_path / "liver.stl")
    loaded = load(tmp_path / "liver.stl", tumours=(str(tmp_path / "tumour.stl"),))
    assert loaded.organ.volume_m3 == pytest.approx(BALL_M3, rel=0.02)
    assert len(loaded.organ.to_trimesh().split()) == 1  # the hole is filled
    assert any("joined to the organ" in notice for notice in loaded.notices)


def test_a_tumour_that_lies_apart_or_is_larger_is_none_of_the_organs(tmp_path):
    T, organ, tumour, _ = masks((0.0, 0.0, 72.0))  # a gap of 6 mm
    liver = save_nifti(tmp_path / "liver.nii.gz", organ, T)
    nodule = save_nifti(tmp_path / "nodule.nii.gz", tumour, T)
    for first, other in ((liver, nodule), (nodule, liver)):
        loaded = load(first, tumours=(str(other),), spacing_m=(6e-3, 6e-3, 6e-3))
        assert not any("joined" in notice for notice in loaded.notices)
        with pytest.raises(AnatomyError, match="of it lies inside the organ"):
            build_anatomy(loaded.organ, loaded.tumours, name="x", rng=np.random.default_rng(0))


def test_a_tumour_inside_leaves_the_organ_as_it_was_to_the_bit(tmp_path):
    T, _, tumour, _ = masks((18.0, -10.0, 12.0))
    organ = masks((500.0, 0.0, 0.0))[1]
    liver = save_nifti(tmp_path / "liver.nii.gz", organ, T)
    nodule = save_nifti(tmp_path / "nodule.nii.gz", tumour, T)
    alone, both = load(liver), load(liver, tumours=(str(nodule),))
    assert np.array_equal(alone.organ.vertices_m, both.organ.vertices_m)
    assert np.array_equal(alone.organ.faces, both.organ.faces)

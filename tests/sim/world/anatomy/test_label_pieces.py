"""Pieces of an organ's label: those that lie together are the organ, and a second one apart is asked about."""

import numpy as np
import pytest
from scanned_ball import CENTRE_MM, ball_labels, grid, load, save_nifti

from sim.world.errors import VolumeError


def balls(tmp_path, *others, half_mm=150.0, radius_mm=40.0):
    """A ball about the centre, and others of radius and offset along x [mm], in one label."""
    T, shape = grid(half_mm=half_mm)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1)
    points_mm = index @ T[:3, :3].T + T[:3, 3]
    labels = np.zeros(shape, np.uint8)
    for radius, offset in ((radius_mm, 0.0), *others):
        labels[np.linalg.norm(points_mm - CENTRE_MM - [offset, 0.0, 0.0], axis=-1) < radius] = 1
    return save_nifti(tmp_path / "seg.nii.gz", labels, T)


def volume_ml(radius_mm):
    return 4e-3 / 3 * np.pi * radius_mm**3


def test_a_piece_far_away_is_no_part_of_the_organ(tmp_path):
    loaded = load(balls(tmp_path, (18.0, 120.0)))  # 9 % of it: no debris
    assert loaded.organ.volume_m3 * 1e6 == pytest.approx(volume_ml(40.0), rel=0.02)
    (notice,) = [text for text in loaded.notices if "dropped" in text]
    assert "an island was dropped beside the organ, 24 ml in all" in notice
    assert "about LPS 60 -20 40 mm" in notice


@pytest.mark.parametrize("radius_mm", [39.0, 40.0])
def test_a_second_piece_nearly_as_large_is_asked_about(tmp_path, radius_mm):
    path = balls(tmp_path, (radius_mm, 105.0))
    with pytest.raises(
        VolumeError, match=r"piece 1 \(2\d\d ml.*piece 2 \(2\d\d ml.*`organ_object` 'piece 1' or"
    ):
        load(path)
    places = [load(path, organ_object=f"piece {n}").organ.bounds_m.mean(axis=0)[0] for n in (1, 2)]
    assert sorted(np.array(places) * 1e3) == pytest.approx([-60.0, 45.0], abs=1.6)  # half a voxel


def test_a_slit_does_not_cut_an_organ_in_two(tmp_path):
    # The balls' surfaces are 4 mm apart: one voxel of 3 mm, or two.
    loaded = load(balls(tmp_path, (20.0, 64.0)))
    assert loaded.organ.volume_m3 * 1e6 == pytest.approx(volume_ml(40.0) + volume_ml(20.0), rel=0.02)
    assert any("2 separate pieces, all of which are kept" in notice for notice in loaded.notices)


def test_an_object_by_name_may_be_a_label_and_is_refused_where_there_is_none(tmp_path):
    T, shape = grid()
    path = save_nifti(tmp_path / "seg.nii.gz", ball_labels(T, shape), T)
    with pytest.raises(
        VolumeError, match=r"`organ_object` 'liver' is no name of a label in the file, which holds 1"
    ):
        load(path, organ_object="liver")

"""DICOM's slices as a stack: positions that are rounded, slices that are missing, overlap, or come in any order."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.world.volumes.dicom.slices import stack_of


def slices_at(heights_mm, *, turn_deg=(0.0, 0.0, 0.0), decimals=None):
    """Positions and orientations of slices at heights along their normal."""
    R = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    places = np.array([-120.0, 80.0, 30.0]) + np.asarray(heights_mm)[:, None] * R[:, 2]
    places = places if decimals is None else np.round(places, decimals)
    return places, [[*R[:, 0], *R[:, 1]]] * len(places)


@pytest.mark.parametrize(
    ("spacing_mm", "n", "turn_deg", "decimals"),
    [
        (2.0 / 3.0, 300, (0.0, 0.0, 0.0), None),
        (0.625, 100, (0.0, 0.0, 0.0), 2),
        (1.25, 400, (7.0, -11.0, 3.0), 2),
        (5.0, 3, (0.0, 0.0, 0.0), 0),
    ],
)
def test_an_even_stack_is_one_however_its_positions_are_rounded(spacing_mm, n, turn_deg, decimals):
    order = np.random.default_rng(0).permutation(n)
    places, directions = slices_at(spacing_mm * order, turn_deg=turn_deg, decimals=decimals)
    stack = stack_of(places, directions, [0.8, 0.7])
    np.testing.assert_array_equal(stack.indices, order)
    found = stack.T_lps_voxel[:3, :3] @ [0.0, 0.0, 1.0]
    assert 1e3 * np.linalg.norm(found) == pytest.approx(spacing_mm, abs=0.02 / (n - 1))


def test_slices_that_are_missing_leave_gaps_and_segments_share_slices():
    places, directions = slices_at(1.5 * np.array([4, 9, 4, 5, 11, 9]))
    stack = stack_of(places, directions, [1.0, 1.0])
    assert stack.indices.tolist() == [0, 5, 0, 1, 7, 5]
    places, directions = slices_at(1.5 * np.array([0, 2, 4]))
    assert stack_of(places, directions, [1.0, 1.0], slice_spacing_mm=-1.5).indices.tolist() == [0, 2, 4]


def test_a_thickness_is_no_spacing_but_of_one_slice_alone():
    places, directions = slices_at(1.5 * np.arange(20))
    for thickness_mm in (0.75, 3.0):
        assert stack_of(places, directions, [1.0, 1.0], thickness_mm=thickness_mm).n_slices == 20
    alone = stack_of(places[:1], directions[:1], [1.0, 1.0], thickness_mm=3.0)
    assert 1e3 * alone.T_lps_voxel[2, 2] == pytest.approx(3.0)
    with pytest.raises(ValueError, match="says nothing of its thickness"):
        stack_of(places[:1], directions[:1], [1.0, 1.0])


@pytest.mark.parametrize(
    "heights_mm",
    [
        [0.0, 1.0, 2.0, 3.3],
        [0.0, 1.0, 1.5, 2.0, 3.7],
        [0.0, 1.0, 2.0, 2.4, 3.0],
    ],
)
def test_uneven_slices_are_refused(heights_mm):
    places, directions = slices_at(heights_mm)
    with pytest.raises(ValueError, match="not evenly spaced"):
        stack_of(places, directions, [1.0, 1.0])


@pytest.mark.parametrize(("true_mm", "told_mm"), [(1.5, 3.5), (3.0, 2.0), (2.5, 1.0), (5.6, 0.6), (1.5, 1.0)])
def test_where_slices_do_not_lie_at_the_spacing_that_is_told_their_positions_count(true_mm, told_mm):
    places, directions = slices_at(true_mm * np.arange(20))
    stack = stack_of(places, directions, [1.0, 1.0], slice_spacing_mm=told_mm)
    assert stack.n_slices == 20
    assert 1e3 * stack.T_lps_voxel[2, 2] == pytest.approx(true_mm)

"""Reports: labelled images become points where their voxels lie, thinned without a pattern."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim.live.errors import RefusedError
from sim.live.reports import MOST_POINTS, points_of_image, reading_of, thinned


def test_points_of_an_image_lie_at_their_voxels_with_their_labels():
    labels = np.zeros((3, 4, 5), dtype=np.uint8)
    labels[1, 2, 3], labels[2, 0, 4] = 1, 2
    T = np.diag([0.001, 0.002, 0.003, 1.0])
    T[:3, 3] = [0.1, 0.2, 0.3]
    # The image of a message is transposed, so that its memory is not in the order of its indices.
    found = points_of_image(np.asfortranarray(labels), T, most=10, stamp_s=None)
    np.testing.assert_allclose(found.points_m, [[0.101, 0.204, 0.309], [0.102, 0.2, 0.312]])
    assert found.is_occupied.tolist() == [False, True]


@pytest.mark.parametrize("wrong", [-1, 3, 255])
def test_labels_that_mean_nothing_are_refused(wrong):
    labels = np.full((2, 2, 2), wrong, dtype=np.int16)
    with pytest.raises(RefusedError, match="labels other than"):
        points_of_image(labels, np.eye(4), most=10, stamp_s=None)


def test_a_large_image_is_thinned_evenly():
    labels = np.ones((60, 60, 60), dtype=np.uint8)
    labels[30:] = 2
    found = points_of_image(labels, np.eye(4), most=1000, stamp_s=None)
    assert len(found.points_m) == len(np.unique(found.points_m, axis=0)) == 1000
    # Halves get equally many, to five standard deviations of a draw.
    assert abs(found.is_occupied.mean() - 0.5) < 5.0 * 0.5 / np.sqrt(1000)
    np.testing.assert_allclose(found.points_m.mean(axis=0), 29.5, atol=5.0 * 17.3 / np.sqrt(1000))
    assert thinned(5, 10).tolist() == [0, 1, 2, 3, 4]


def test_points_are_thinned_once_it_is_known_which_of_them_lie_in_the_organ():
    report = points_of_image(np.ones((100, 100, 100), dtype=np.uint8), np.eye(4), stamp_s=None)
    corner = SimpleNamespace(contains=lambda points_m: (points_m < 46.0).all(axis=1))
    reading = reading_of(report, np.eye(4), SimpleNamespace(organ=corner))
    # A tenth of the image is in the organ, and as much is learnt of it as may be learnt of any reading.
    assert len(reading.points_m) == MOST_POINTS
    assert (reading.points_m < 46.0).all()

"""A reading refuses arrays that do not belong together."""

from __future__ import annotations

import numpy as np
import pytest

from sim.world.sensing.reading import Reading

POINTS_M, FREE = np.zeros((2, 3)), np.zeros(2, dtype=bool)


def test_arrays_that_belong_together_are_taken() -> None:
    assert Reading(POINTS_M, FREE, np.eye(4)).is_target is None
    assert Reading(np.empty((0, 3)), FREE[:0], np.eye(4), FREE[:0]).points_m.shape == (0, 3)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ((np.zeros((2, 2)), FREE, np.eye(4)), r"points_m of a reading has shape \(2, 2\), expected \(2, 3\)"),
        ((POINTS_M, FREE[:1], np.eye(4)), r"is_occupied of a reading has shape \(1,\), expected \(2,\)"),
        ((POINTS_M, FREE[:, None], np.eye(4)), r"is_occupied of a reading has shape \(2, 1\)"),
        ((POINTS_M, FREE, np.eye(3)), r"T_world_probe of a reading has shape \(3, 3\), expected \(4, 4\)"),
        ((POINTS_M, FREE, np.eye(4), FREE[:1]), r"is_target of a reading has shape \(1,\)"),
        ((POINTS_M, np.zeros(2), np.eye(4)), "is_occupied of a reading holds values of type float64"),
        ((POINTS_M, FREE, np.eye(4), np.zeros(2, int)), "is_target of a reading holds values of type int64"),
    ],
)
def test_others_are_refused(arrays, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Reading(*arrays)

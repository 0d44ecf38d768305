"""How far readings go when the belief moves: by their own points, and not by the corners of a box."""

import numpy as np
from scipy.spatial.transform import Rotation

from mapping import LabelledPoints
from mapping.registration import most_moved_m, moved_m


def reading(points_m) -> LabelledPoints:
    points_m = np.array(points_m, dtype=float).reshape(-1, 3)
    return LabelledPoints(points_m, np.zeros(len(points_m), dtype=bool))


def turned(angle_rad, shift_m=(0.0, 0.0, 0.0)) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.0, 0.0, angle_rad]).as_matrix()
    T[:3, 3] = shift_m
    return T


def test_points_move_by_their_arm() -> None:
    gap_m = moved_m(np.array([[0.1, 0.0, 0.3], [0.0, 0.0, 0.3]]), turned(0.02) - turned(0.0))
    # A chord of the circle about z.
    np.testing.assert_allclose(gap_m, [0.1 * 2.0 * np.sin(0.01), 0.0], atol=1e-15)


def test_the_reading_that_moved_most_counts_by_its_root_mean_square() -> None:
    near, far = reading([[0.01, 0.0, 0.0]]), reading([[0.03, 0.0, 0.0], [0.04, 0.0, 0.0]])
    nothing, before = reading([]), [turned(0.0)] * 3
    now = [turned(0.1), turned(0.1), turned(0.0, (9.0, 0.0, 0.0))]
    expected_m = 2.0 * np.sin(0.05) * np.sqrt(0.5 * (0.03**2 + 0.04**2))
    # A reading without points has moved by nothing.
    assert np.isclose(most_moved_m([near, far, nothing], now, before), expected_m)
    assert most_moved_m([nothing], now[:1], before[:1]) == 0.0

"""Readings taken in together: nothing that was said is lost, what agrees is said once, and doubts are kept."""

from __future__ import annotations

import numpy as np

from mapping import LabelledPoints, merged

RNG = np.random.default_rng(3)
SPACING_M = 0.004


def ball_reading(n: int) -> LabelledPoints:
    points_m = RNG.uniform(0.0, 0.04, (n, 3))
    return LabelledPoints(points_m, np.linalg.norm(points_m - 0.02, axis=1) < 0.01)


def cubes(points_m: np.ndarray) -> list[tuple[int, ...]]:
    return [tuple(each) for each in np.floor(points_m / SPACING_M).astype(int).tolist()]


def test_every_cube_keeps_its_labels_and_the_first_reading_all_of_its_points() -> None:
    readings = [ball_reading(900) for _ in range(4)]
    (one,) = merged(readings, SPACING_M)
    points_m = np.concatenate([each.points_m for each in readings])
    is_occupied = np.concatenate([each.is_occupied for each in readings])
    said = set(zip(cubes(points_m), is_occupied.tolist(), strict=True))
    assert set(zip(cubes(one.points_m), one.is_occupied.tolist(), strict=True)) == said
    np.testing.assert_array_equal(one.points_m[:900], readings[0].points_m)
    assert len(one.points_m) < 0.7 * len(points_m)
    # Where labels of a cube differ, its edge runs through it, and all of them stay.
    mixed = {cube for cube, label in said if label} & {cube for cube, label in said if not label}
    count = [sum(cube in mixed for cube in cubes(each)) for each in (points_m, one.points_m)]
    assert count[0] == count[1] > 0


def test_labels_that_may_be_wrong_are_all_kept() -> None:
    readings = [ball_reading(50) for _ in range(2)]
    doubtful = [
        LabelledPoints(each.points_m, each.is_occupied, log_odds=np.full(50, 2.0), weight=np.full(50, 0.5))
        for each in readings
    ]
    (one,) = merged(doubtful, SPACING_M)
    assert len(one.points_m) == len(one.log_odds) == len(one.weight) == 100
    assert len(merged(readings, 0.0)[0].points_m) == 100
    assert merged([readings[0], doubtful[1]], SPACING_M) == [readings[0], doubtful[1]]


def test_one_reading_is_itself() -> None:
    reading = ball_reading(10)
    assert merged([reading], SPACING_M) == [reading]
    assert merged([reading], SPACING_M)[0] is reading

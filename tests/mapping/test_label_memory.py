"""The memory of labels: thinned out, and in play near tumour, against brute force over all readings."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping import DetailSettings
from mapping.labelled_points import LabelledPoints
from mapping.near_tumour.label_memory import LabelMemory
from mapping.near_tumour.local_classifier import classify

CUBE_M, RANGE_M = 0.004, 0.011


def some_readings(seed, n_readings):
    rng = np.random.default_rng(seed)
    for number in range(n_readings):
        points_m = rng.uniform(-0.03, 0.03, (rng.integers(0, 60), 3))
        is_tumour = (np.linalg.norm(points_m - 0.01, axis=1) < 0.012) & (number > 0)
        yield LabelledPoints(points_m, is_tumour)


@given(st.integers(0, 10**6), st.integers(1, 6))
@settings(deadline=None, max_examples=30)
def test_what_is_kept_and_in_play_is_what_brute_force_over_all_readings_finds(seed, n_readings):
    memory = LabelMemory(cube_m=CUBE_M, range_m=RANGE_M, false_positive_rate=0.0)
    told = list(some_readings(seed, n_readings))
    entered_m = np.concatenate([memory.add(reading)[2] for reading in told])
    points_m = np.concatenate([reading.points_m for reading in told])
    labels = np.concatenate([reading.is_occupied for reading in told])
    seen, kept = set(), []
    for i, (point_m, label) in enumerate(zip(points_m, labels, strict=True)):
        key = (*np.floor(point_m / CUBE_M).astype(int).tolist(), bool(label))
        if key not in seen:
            seen.add(key)
            kept.append(i)
    np.testing.assert_array_equal(memory.points_m, points_m[kept])
    np.testing.assert_array_equal(memory.is_tumour, labels[kept])
    tumour_m = points_m[labels]
    gaps_m = np.linalg.norm(points_m[kept][:, None] - tumour_m, axis=2).min(axis=1, initial=np.inf)
    np.testing.assert_array_equal(memory.is_in_play, gaps_m < RANGE_M)
    # Each point enters once.
    assert sorted(map(tuple, entered_m)) == sorted(map(tuple, points_m[kept][gaps_m < RANGE_M]))


def test_neighbours_are_the_nearest_in_play():
    memory = LabelMemory(cube_m=1e-6, range_m=RANGE_M, false_positive_rate=0.0)
    for reading in some_readings(4, 5):
        memory.add(reading)
    asked_m = np.random.default_rng(1).uniform(-0.02, 0.02, (20, 3))
    distance_m, nearest = memory.neighbours(asked_m, 9)
    points_m, is_tumour = memory.points_m[nearest], memory.is_tumour[nearest]
    in_play_m, labels = memory.points_m[memory.is_in_play], memory.is_tumour[memory.is_in_play]
    for i, place_m in enumerate(asked_m):
        gaps_m = np.linalg.norm(in_play_m - place_m, axis=1)
        nearest = np.argsort(gaps_m)[:9]
        np.testing.assert_allclose(distance_m[i], gaps_m[nearest])
        np.testing.assert_array_equal(points_m[i], in_play_m[nearest])
        np.testing.assert_array_equal(is_tumour[i], labels[nearest])


def test_scattered_false_labels_bring_nothing_into_play_where_the_sensor_is_known_to_make_them():
    rng = np.random.default_rng(5)
    reading = LabelledPoints(rng.uniform(-0.05, 0.05, (1000, 3)), rng.random(1000) < 0.02)
    trusting = LabelMemory(cube_m=CUBE_M, range_m=RANGE_M, false_positive_rate=0.0)
    knowing = LabelMemory(cube_m=CUBE_M, range_m=RANGE_M, false_positive_rate=0.02)
    trusting.add(reading)
    knowing.add(reading)
    assert len(trusting.tumour_m) == reading.is_occupied.sum()
    assert len(knowing.tumour_m) <= 1  # one in a thousand labels passes by chance


def test_labels_that_say_nothing_leave_a_place_all_but_as_it_was():
    """At log odds of zero a label of tumour would have an infinite spread."""
    rng, settings = np.random.default_rng(0), DetailSettings()
    memory = LabelMemory(cube_m=1e-6, range_m=0.02, false_positive_rate=0.0)
    points_m = rng.uniform(-0.004, 0.004, (24, 3))
    told = LabelledPoints(points_m, np.ones(24, bool), np.zeros(24), np.full(24, 1 / 24))
    memory.add(told)
    memory.is_in_play[:] = True
    nearest = np.arange(24)[None]
    mean, variance = classify(np.zeros((1, 3)), memory.neighbours_of(nearest, (0.0, 0.0)), settings)
    assert np.isfinite(mean).all()
    assert variance[0] > 0.5 * settings.variance


def test_what_labels_tell_becomes_rates_of_which_one_is_zero():
    memory = LabelMemory(cube_m=1e-6, range_m=1.0, false_positive_rate=0.0)
    points_m = np.array([[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.0, 0.001, 0.0]])
    labels = np.array([True, False, True])
    memory.add(LabelledPoints(points_m, labels, np.array([3.0, -2.0, 6.0]), np.full(3, 0.25)))
    own = memory.neighbours_of(np.array([[0, 1, 2]]), (0.0, 0.0))
    np.testing.assert_allclose(own.false_positive, [[np.exp(-3.0), 0.0, np.exp(-6.0)]])
    np.testing.assert_allclose(own.false_negative, [[0.0, np.exp(-2.0), 0.0]])
    np.testing.assert_allclose(own.weight, [[1 / 3] * 3])

"""A timed path is checked against every limit before it is sent, and goes on slowly where an arm was stopped."""

import numpy as np
import pytest
from arm_paths import LIMITS, path

from sim.live.arm.messages import BrokenMessageError, path_of, trajectory_of
from sim.live.arm.timed_path import PathRefusedError, TimedPath


def changed(of, **values):
    return TimedPath(**({"names": of.names, "time_s": of.time_s, "q": of.q, "speed": of.speed} | values))


def test_a_path_within_the_limits_is_taken() -> None:
    path().check(LIMITS)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (path(ends=(1.1, 0.0)), "a would go to 1.0"),
        (path(ends=(-1.1, 0.0)), "a would go to -1.0"),
        (path(ends=(0.0, 2.0)), "b would move at 1.0"),
        (path(ends=(0.8, 0.1), duration_s=0.5), "a would move at 2.0"),
        # Speeds that are stated may lie: those between positions count too.
        (changed(path(ends=(0.8, 0.1), duration_s=0.5), speed=np.zeros((101, 2))), "a would move at 2.0"),
        (changed(path(), speed=np.ones((101, 2))), "begin and end at rest"),
        (changed(path(), time_s=path().time_s[::-1].copy()), "do not rise"),
        (changed(path(), q=np.full((101, 2), np.nan)), "not finite"),
        (changed(path(), q=np.zeros((3, 2))), "not equally many"),
    ],
)
def test_a_path_beyond_a_limit_is_refused_with_the_joint_and_the_value(given, text) -> None:
    with pytest.raises(PathRefusedError, match=text):
        given.check(LIMITS)


@pytest.mark.parametrize("row", [0, 1, 30, 77, 99, 100])
def test_a_path_goes_on_from_where_the_arm_stands_to_the_same_end(row) -> None:
    whole, off = path(), np.array([0.004, -0.003])
    rest = whole.rest_from(whole.q[row] + off, farthest=0.01)
    rest.check(LIMITS)
    np.testing.assert_allclose(rest.q[0], whole.q[row] + off, atol=1e-12)
    np.testing.assert_allclose(rest.q[-1], whole.q[-1], atol=1e-12)
    # It leaves the path by no more than it was off, and is as fast as the path at most, but for that fading out.
    away = (
        np.abs(rest.q[:, None] - np.linspace(whole.q[:-1], whole.q[1:], 20).reshape(-1, 2))
        .max(axis=2)
        .min(axis=1)
    )
    assert away.max() < 0.0041
    # The last sample before the end is 1 ms away; what is left to fade over one step is small beside the limit.
    assert np.abs(np.diff(rest.q, axis=0) / np.diff(rest.time_s)[:, None]).max() < 0.8 * np.pi / 4.0 + 0.3


def test_the_speeds_of_a_path_that_goes_on_are_those_of_its_positions() -> None:
    whole = path(n=2001)
    rest = whole.rest_from(whole.q[400], farthest=1e-3)
    between = np.diff(rest.q, axis=0) / np.diff(rest.time_s)[:, None]
    middle = 0.5 * (rest.speed[1:] + rest.speed[:-1])
    # Differences of a curve sampled every millisecond; the first step of the ramp is a hundredth of a second.
    np.testing.assert_allclose(between, middle, atol=2e-2)
    assert rest.duration_s == pytest.approx(whole.duration_s - whole.time_s[400] + 0.2, abs=1e-9)


def test_an_arm_that_stands_elsewhere_is_not_sent_on() -> None:
    with pytest.raises(PathRefusedError, match="off its path"):
        path().rest_from([0.4, 0.4], farthest=0.02)
    with pytest.raises(PathRefusedError, match="off its path"):
        path().begun_at([0.4, -0.25], farthest=0.02)  # on the path, but not at its beginning


def test_a_path_survives_its_message_to_the_nanosecond() -> None:
    given = path()
    taken = path_of(trajectory_of(given))
    np.testing.assert_allclose(taken.time_s, given.time_s, atol=0.5e-9)
    np.testing.assert_array_equal(taken.q, given.q)
    np.testing.assert_array_equal(taken.speed, given.speed)
    assert taken.names == given.names


ONE_POINT = {"positions": [0.0], "velocities": [0.0], "time_from_start": {"sec": 0, "nanosec": 0}}


@pytest.mark.parametrize(
    "trajectory",
    [
        None,
        [],
        {},
        {"joint_names": ["a"], "points": [{}]},
        {"joint_names": [], "points": []},
        {"joint_names": ["a", "a"], "points": []},
        {"joint_names": ["a"], "points": [ONE_POINT | {"positions": [1.0, 2.0]}]},
        {"joint_names": ["a"], "points": [ONE_POINT | {"positions": [float("nan")]}]},
    ],
)
def test_what_is_no_trajectory_is_refused(trajectory) -> None:
    with pytest.raises(BrokenMessageError):
        path_of(trajectory)

"""The simulated arm, by its own clock: it follows, refuses what passes a limit, and stops when it hears nobody."""

import numpy as np
import pytest
from arm_paths import LIMITS, path
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.live.arm.controller import Status
from sim.live.arm.messages import BEAT, FOLLOW, STOP, trajectory_of
from sim.live.arm.simulated_arm import SimulatedArm, SimulatedArmSettings
from sim.live.arm.timed_path import ArmLimits


def arm(error_q=(0.0, 0.0)):
    return SimulatedArm(
        SimulatedArmSettings(
            names=("a", "b"), limits=LIMITS, start_q=np.zeros(2), error_q=np.array(error_q, dtype=float)
        )
    )


def sent(goal=1, **options):
    return {"op": FOLLOW, "goal": goal, "trajectory": trajectory_of(path(**options))}


def run(of, seconds, beats=True):
    for _ in range(round(seconds / of.settings.tick_s)):
        if beats:
            of.hear({"op": BEAT})
        of.tick()


def test_it_arrives_where_it_was_sent_but_for_its_error() -> None:
    one = arm(error_q=(0.002, -0.001))
    one.hear(sent())
    run(one, 2.1)
    assert one.state.status is Status.DONE
    np.testing.assert_allclose(one.q, [0.802, -0.501], atol=1e-12)


def test_it_rests_within_100_ms_of_the_last_word_by_its_own_clock() -> None:
    for silent_after_s in np.arange(0.0, 1.9, 0.035):
        one = arm()
        one.hear(sent())
        run(one, silent_after_s)
        run(one, 0.1, beats=False)
        assert one.state.status is Status.STOPPED
        assert not one.record["is_moving"]
        assert one.record["longest_unheard_s"] <= 0.1
        before = one.q.copy()
        run(one, 1.0)  # beats alone do not set it in motion again
        np.testing.assert_array_equal(one.q, before)
        # It came to rest on its path.
        share = one.q[0] / 0.8
        np.testing.assert_allclose(one.q, [0.8 * share, -0.5 * share], atol=1e-4)


def test_it_stops_when_it_is_told_to() -> None:
    one = arm()
    one.hear(sent())
    run(one, 0.5)
    one.hear({"op": STOP})
    run(one, 0.05)
    assert one.state.status is Status.STOPPED
    assert one.state.text == "It was told to stop."


@settings(deadline=None, max_examples=60)
@given(
    ends=st.tuples(*[st.floats(-1.5, 1.5)] * 2),
    duration_s=st.floats(0.2, 3.0),
    beat_share=st.floats(0.3, 1.0),
    seed=st.integers(0, 1000),
)
def test_joints_pass_no_limit_whatever_is_sent_and_whatever_is_lost(
    ends, duration_s, beat_share, seed
) -> None:
    one, rng = arm(), np.random.default_rng(seed)
    one.hear(sent(ends=ends, duration_s=duration_s))
    for _ in range(700):
        if rng.random() < beat_share:
            one.hear({"op": BEAT})
        one.tick()
    noted = one.record
    assert (np.array(noted["lowest"]) >= LIMITS.low - 1e-6).all()
    assert (np.array(noted["highest"]) <= LIMITS.high + 1e-6).all()
    assert (np.array(noted["fastest"]) <= LIMITS.speed * 1.002).all()
    assert noted["longest_unheard_s"] <= 0.1


def test_a_path_that_begins_elsewhere_or_is_of_other_joints_is_refused() -> None:
    one = arm()
    one.q = np.array([0.3, 0.0])
    one.hear(sent())
    assert one.state.status is Status.REFUSED
    assert "begins 0.3" in one.state.text
    other = sent(goal=2)
    other["trajectory"]["joint_names"] = ["b", "a"]
    one.hear(other)
    assert one.state.goal == 2
    assert one.state.text == "The path is of other joints."


def test_a_path_that_is_said_twice_is_followed_once() -> None:
    one = arm()
    one.hear(sent())
    run(one, 2.1)
    one.hear(sent())
    run(one, 0.5)
    np.testing.assert_allclose(one.q, [0.8, -0.5], atol=1e-12)
    assert one.state.status is Status.DONE


@pytest.mark.parametrize(
    "message", [{"op": "dance"}, {"op": FOLLOW}, {"op": FOLLOW, "goal": "1"}, {"op": FOLLOW, "goal": 1}]
)
def test_what_is_broken_moves_nothing(message) -> None:
    one = arm()
    one.hear(message)
    run(one, 0.5)
    np.testing.assert_array_equal(one.q, np.zeros(2))


def test_limits_of_both_sides_hold() -> None:
    mine = ArmLimits(low=np.array([-2.0]), high=np.array([0.5]), speed=np.array([1.0]))
    both = mine.within(ArmLimits(low=np.array([-1.0]), high=np.array([np.inf]), speed=np.array([3.0])))
    assert (both.low[0], both.high[0], both.speed[0]) == (-1.0, 0.5, 1.0)

"""The motion that an arm follows keeps the joints' limits and the tip's speed, not only the path that was planned."""

from __future__ import annotations

import copy
import sys

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.world.motion.curve import rounded, through
from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.timing import PathTimer
from sim.world.scene.arm import MODELS_DIR

DT_S = 0.001


@pytest.fixture(scope="module")
def limits(search):
    return JointLimits.of_arm(MODELS_DIR / "arm.xml", search.chain.is_slide)


@pytest.fixture(scope="module", params=["toppra", "plain"])
def timer(request, search, limits):
    """The timer with toppra, and without it, as on systems for which there is no wheel of it."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "plain":
            patch.setitem(sys.modules, "toppra", None)
        else:
            pytest.importorskip("toppra", reason="toppra is not installed here")
        yield PathTimer(search.chain, limits)


def beyond(chain, q) -> float:
    """How far configurations go beyond a limit at most, shape (T, n)."""
    return float(np.maximum(chain.low - q, q - chain.high).max())


def into_a_limit(chain, *, joint: int, way: float) -> np.ndarray:
    """A path that runs into the upper limit of a joint, goes on along it, and comes back."""
    path = np.tile(chain.home, (4, 1))
    path[:, joint] = chain.high[joint] - [way, 0.0, 0.0, way / 2]
    path[:, 0] = [0.0, 0.1, 0.6, 0.8]
    return path


@pytest.mark.parametrize("joint", [2, 3, 5])
@pytest.mark.parametrize("way", [0.2, 0.6, 1.5])
def test_a_spline_that_swings_beyond_a_limit_is_brought_back(timer, search, limits, joint, way) -> None:
    chain, path = search.chain, into_a_limit(search.chain, joint=joint, way=way)
    curve = through(rounded(path))
    # Without limits of its own the same timer follows the spline as it is.
    free = copy.copy(chain)
    free.low, free.high = np.full(7, -np.inf), np.full(7, np.inf)
    loose = PathTimer(free, limits).time(curve, tip_speed_m_s=0.25, dt_s=DT_S)
    over = beyond(chain, loose.q)
    assert over > 1e-6
    held = timer.time(curve, tip_speed_m_s=0.25, dt_s=DT_S)
    assert beyond(chain, held.q) <= 1e-9
    np.testing.assert_allclose(held.q[[0, -1]], path[[0, -1]], atol=1e-9)
    assert np.abs(held.speed[[0, -1]]).max() < 1e-9
    # At the same share of the time the joint is where it was, but for what it was beyond and 0.1 mrad of the spline.
    at = np.column_stack(
        [
            np.interp(held.time_s / held.time_s[-1], loose.time_s / loose.time_s[-1], column)
            for column in loose.q.T
        ]
    )
    assert np.abs(held.q - at).max() < over + 3e-4
    others = np.arange(7) != joint
    assert np.abs(held.q - at)[:, others].max() < 3e-4


def test_a_motion_within_its_limits_is_the_same_to_the_byte(timer, search, limits) -> None:
    chain = search.chain
    free = copy.copy(chain)
    free.low, free.high = np.full(7, -np.inf), np.full(7, np.inf)
    path = chain.home + np.array(
        [[0.0] * 7, [0.4, 0.2, 0.0, -0.3, 0.1, 0.2, 0.3], [0.9, 0.0, 0.2, 0.1, 0.0, 0.0, 0.1]]
    )
    motions = [
        each.time(through(rounded(path)), tip_speed_m_s=0.25, dt_s=0.01)
        for each in (timer, PathTimer(free, limits))
    ]
    assert motions[0].q.tobytes() == motions[1].q.tobytes()
    assert motions[0].speed.tobytes() == motions[1].speed.tobytes()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.05, 0.25]))
def test_no_limit_is_passed_on_any_path_between_configurations(
    timer, search, limits, scene, seed, tip_m_s
) -> None:
    """By finite differences of what is followed, and by MuJoCo's own Jacobian."""
    chain, rng = search.chain, np.random.default_rng(seed)
    corners = rng.uniform(chain.low, chain.high, (rng.integers(2, 5), 7))
    # Every other one with some joints at their limits, as answers at the rim of the reach have them.
    corners = np.where(
        rng.uniform(size=corners.shape) < 0.3, np.where(corners > chain.home, chain.high, chain.low), corners
    )
    motion = timer.time(through(rounded(corners)), tip_speed_m_s=tip_m_s, dt_s=DT_S)
    assert beyond(chain, motion.q) <= 1e-9
    dt_s = np.diff(motion.time_s)[:, None]
    tips_m = chain.forward(motion.q).tips_m
    # What is let pass for some milliseconds, 0.1 %, and half as much for the peaks between two looks.
    assert np.linalg.norm(np.diff(tips_m, axis=0) / dt_s, axis=1).max() <= tip_m_s * 1.0015
    speed = np.diff(motion.q, axis=0) / dt_s
    assert (np.abs(speed) <= limits.speed * 1.002).all()
    data, jacobian = scene.new_data(), np.zeros((3, scene.model.nv))
    tip = scene.model.site(scene.tip_site).id
    for row in range(0, len(motion.q), 97):
        data.qpos[:] = motion.q[row]
        mujoco.mj_kinematics(scene.model, data)
        mujoco.mj_comPos(scene.model, data)
        mujoco.mj_jacSite(scene.model, data, jacobian, None, tip)
        assert np.linalg.norm(jacobian @ motion.speed[row]) <= tip_m_s * 1.0015

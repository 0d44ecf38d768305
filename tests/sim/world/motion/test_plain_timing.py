"""Timing where toppra is not installed: a little slower, and on the same way; for its limits see test_timing.py."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from sim.world.motion.curve import rounded, through
from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.plain_timing import plain_motion
from sim.world.motion.timing import PathTimer
from sim.world.scene.arm import MODELS_DIR


@pytest.fixture(scope="module")
def limits(search):
    return JointLimits.of_arm(MODELS_DIR / "arm.xml", search.chain.is_slide)


@pytest.mark.parametrize("seed", range(8))
def test_without_toppra_motions_take_somewhat_longer_along_the_same_way(
    search, limits, seed, monkeypatch
) -> None:
    pytest.importorskip("toppra", reason="toppra is not installed here")
    chain, rng = search.chain, np.random.default_rng(seed)
    curve = through(rounded(rng.uniform(chain.low, chain.high, (rng.integers(2, 5), 7))))
    best = PathTimer(chain, limits).time(curve, tip_speed_m_s=10.0, dt_s=0.002)
    monkeypatch.setitem(sys.modules, "toppra", None)
    plain = PathTimer(chain, limits).time(curve, tip_speed_m_s=10.0, dt_s=0.002)
    # Each of the two parts of an acceleration has half of the limit: at most sqrt(2), and a little for the grids.
    assert 0.97 < plain.time_s[-1] / best.time_s[-1] < np.sqrt(2) * 1.05
    near = np.linalg.norm(plain.q[:, None] - best.q[None, ::5], axis=2).min(axis=1)
    assert near.max() < 0.03  # as far as the samples of the other motion lie apart


def test_a_way_from_rest_to_rest_of_one_joint_takes_the_time_of_a_trapezoid() -> None:
    s = np.linspace(0.0, 2.0, 9)
    followed, duration_s = plain_motion(s, s[:, None], np.array([1.0]), np.array([8.0]))
    # Speeding up and slowing down at half of the limit, 4, takes a quarter of a second and 1/8 each; between is 7/4.
    assert duration_s == pytest.approx(0.25 + 1.75 + 0.25, rel=0.01)
    time_s = np.linspace(0.0, duration_s, 2001)
    q, rate = followed(time_s, 0)[:, 0], followed(time_s, 1)[:, 0]
    assert q[[0, -1]] == pytest.approx([0.0, 2.0], abs=1e-9)
    np.testing.assert_allclose(np.gradient(q, time_s), rate, atol=5e-3)
    assert rate.max() <= 1.0 + 1e-9
    assert np.abs(followed(time_s, 2)).max() <= 4.0 + 1e-9

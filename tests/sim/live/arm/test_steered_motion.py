"""The motion of an arm whose controller is in memory: its clock, where it is found, and whether it is sent anything."""

from dataclasses import replace

import numpy as np
import pytest

from sim.episode.moving.motion import ProcedureStoppedError
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import build_setup
from sim.live.arm.controller import ArmController, ArmState, Status
from sim.live.arm.steered_motion import STATE_S, SteeredMotion, elapsed
from sim.live.arm.timed_path import ArmLimits
from sim.world.motion.settings import MotionSettings
from sim.world.scene.arm import ArmModel


class MemoryArm(ArmController):
    """An arm that is at the end of each path at once, and whose clock says what it is told to on the way."""

    def __init__(self, chain, stamps_s=(0.0, 1.0)):
        self.names, self.paths, self.status = tuple(chain.names), [], Status.DONE
        free = np.full(chain.n_joints, np.inf)
        self.limits, self.q, self._stamps_s = (
            ArmLimits(low=-free, high=free, speed=free),
            chain.home,
            stamps_s,
        )

    def state(self):
        return ArmState(stamp_s=self._stamps_s[0], q=self.q, speed=np.zeros_like(self.q), status=self.status)

    def follow(self, path, watch=lambda state: True):
        self.paths.append(path)
        self.q, n = path.q[-1], len(self._stamps_s) - 1
        rows = np.linspace(0, len(path.q) - 1, n + 1).astype(int)[1:]
        return [
            replace(self.state(), stamp_s=stamp_s, q=path.q[row])
            for stamp_s, row in zip(self._stamps_s[1:], rows, strict=True)
        ]

    def close(self):
        pass


@pytest.fixture(scope="module")
def setup():
    return build_setup(replace(SCENARIOS["sphere"], score_spacing_m=0.012), ArmModel())


@pytest.fixture(scope="module")
def pose(setup):
    return next(pose for pose in range(0, 3000, 150) if setup.positioner.reach(pose).is_reached)


def test_a_clock_that_begins_anew_goes_on() -> None:
    times_s = elapsed([50.0, 51.0, 52.0, 0.1, 5.0])
    np.testing.assert_allclose(times_s, [0.0, 1.0, 2.0, 2.0 + STATE_S, 6.9 + STATE_S])
    np.testing.assert_array_equal(elapsed([3.0]), [0.0])


@pytest.mark.parametrize("stamps_s", [(50.0, 51.0, 52.0, 0.1, 5.0), (1.0, 2.0, 2.0, 2.0)])
def test_the_last_state_counts_whatever_the_clock_says(setup, pose, stamps_s) -> None:
    arm, data = MemoryArm(setup.positioner.search.chain, stamps_s), setup.scene.new_data()
    steered = SteeredMotion(setup, arm, MotionSettings())
    steered.begin(data)
    motion = steered.move(data, pose)
    assert motion.is_done
    np.testing.assert_array_equal(motion.states[-1][setup.positioner.search.chain.columns], arm.q)
    assert (np.diff(motion.time_s) > 0.0).all()
    assert motion.time_s[0] == 0.0


def test_nothing_is_sent_once_the_arm_is_not_to_move(setup, pose) -> None:
    arm, data = MemoryArm(setup.positioner.search.chain), setup.scene.new_data()
    steered = SteeredMotion(setup, arm, MotionSettings(), lambda q: False)
    steered.begin(data)
    with pytest.raises(ProcedureStoppedError, match=r"before it began.*start again with the same options"):
        steered.move(data, pose)
    assert arm.paths == []


def test_an_arm_that_was_moved_while_it_stood_is_found_where_it_is(setup, pose) -> None:
    chain = setup.positioner.search.chain
    arm, data = MemoryArm(chain), setup.scene.new_data()
    steered = SteeredMotion(setup, arm, MotionSettings())
    steered.begin(data)
    assert steered.look(data) == ""
    arm.q = chain.home + np.r_[0.05, np.zeros(chain.n_joints - 1)]
    assert "moved after it had come to rest" in steered.look(data)
    np.testing.assert_array_equal(data.qpos[chain.columns], arm.q)
    # The way on begins there, not where it was left.
    before = arm.q
    assert steered.move(data, pose).is_done
    np.testing.assert_allclose(arm.paths[0].q[0], before, atol=1e-9)
    assert steered.look(data) == ""

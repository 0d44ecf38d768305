"""Force control along a way: the law it follows, and joints that bring the tip along the beam."""

from __future__ import annotations

import numpy as np
import pytest

from sim.episode.moving.held_force import HeldForce, held_together
from sim.episode.sweeping.slide_control import SlideControl, along_beam
from sim.world.ik.chain import Chain
from sim.world.motion.force_control import TIME_CONSTANT_S, ForceGoal
from sim.world.motion.timing import Trajectory

DT_S, K_N_M, GOAL_N = 0.002, 500.0, 2.0
GOAL = ForceGoal(force_n=GOAL_N, search_m=0.01, speed_m_s=0.05, settle_s=0.0)


class Spring:
    """A contact whose depth is what the control did, beside what the surface does by itself."""

    def __init__(self) -> None:
        self.stiffness_n_m, self.force_n = K_N_M, GOAL_N


@pytest.fixture(scope="module")
def chain(sphere_arm_setup) -> Chain:
    return sphere_arm_setup.positioner.search.chain


def slid(chain: Chain, surface_m) -> np.ndarray:
    """The forces of a slide over a surface that lies higher than planned by some metres at a time."""
    contact, seconds = Spring(), 1.0
    still = np.zeros((2, chain.n_joints))
    timed = Trajectory(np.array([0.0, seconds]), still + chain.home, still)
    control = SlideControl(chain, timed, contact, GOAL, dt_s=DT_S)  # type: ignore[arg-type]
    for step, _ in enumerate(control.commands(), start=1):
        contact.force_n = GOAL_N + K_N_M * (control.shift_m + surface_m(step * DT_S))
    return np.array(control.force_n)


def test_an_error_of_the_force_dies_out_with_the_time_constant(chain) -> None:
    forces_n = slid(chain, lambda time_s: 0.0005)
    off_n = np.abs(forces_n[1:] - GOAL_N)
    # From the time on at which the speed is no longer limited by the acceleration, two time constants gain e^2.
    first, later = 15, 15 + round(2.0 * TIME_CONSTANT_S / DT_S)
    assert off_n[0] == pytest.approx(K_N_M * 0.0005, rel=0.1)
    assert off_n[later] / off_n[first] == pytest.approx(np.exp(-2.0), rel=0.25)
    assert off_n[-1] < 1e-6


def test_a_slope_leaves_the_force_of_its_lag(chain) -> None:
    slope_m_s = 0.005
    forces_n = slid(chain, lambda time_s: slope_m_s * time_s)
    # ds/dt = -(F - F_wanted) / (k tau) is as fast as the slope where F - F_wanted = k tau times it.
    assert forces_n[-1] - GOAL_N == pytest.approx(K_N_M * TIME_CONSTANT_S * slope_m_s, rel=1e-3)


def test_joints_bring_the_tip_along_the_beam_and_keep_its_direction(chain) -> None:
    q, step_m = chain.home[None], 1e-4
    before, after = chain.forward(q), chain.forward(q + step_m * along_beam(chain, q))
    went_m = after.tips_m[0] - before.tips_m[0]
    # The second order of a step of 0.1 mm over levers of half a metre is some 1e-8 m; the damping takes a millionth.
    np.testing.assert_allclose(went_m, step_m * before.beams[0], atol=1e-7)
    np.testing.assert_allclose(after.beams[0], before.beams[0], atol=1e-6)


def test_figures_of_held_forces_are_those_of_their_steps() -> None:
    one = HeldForce(
        wanted_n=2.0, force_n=np.array([2.0, 2.3, 1.7, 2.5]), slip_m=np.array([1e-4, 3e-4]), lag_m=np.zeros(2)
    )
    assert one.force_in_band == 0.75
    assert one.slide_force_error_n == pytest.approx(np.sqrt((0.09 + 0.09 + 0.25) / 4.0))
    both = held_together([one, HeldForce.nothing(2.0), one])
    assert both is not None
    assert (both.force_in_band, both.slide_slip_m, len(both.force_n)) == (0.75, 3e-4, 8)
    nothing = HeldForce.nothing(2.0)
    assert (nothing.force_in_band, nothing.slide_force_error_n, nothing.slide_slip_m) == (None, None, None)
    assert held_together([]) is None

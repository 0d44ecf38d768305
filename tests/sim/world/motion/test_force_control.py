"""Contact along a beam, and control of its force: against a ball, and against an organ that follows a law."""

import re

import numpy as np
import pytest

from sim.world.errors import TissueError
from sim.world.motion.beam_contact import BeamContact
from sim.world.motion.force_control import FINE_M, TIME_CONSTANT_S, BeamLine, ForceControl, ForceGoal

DT_S, K_N_M = 0.002, 90.0
CENTRE_M, BALL_M = np.array([0.5, 0.0, 0.06]), 0.06
DOWN = np.array([0.0, 0.0, -1.0])


class Drifting:
    """An organ that moves at a steady speed."""

    def __init__(self, speed_m_s=(0.0, 0.0, 0.0)) -> None:
        self._speed_m_s = np.array(speed_m_s)

    @property
    def is_moving(self) -> bool:
        return bool(self._speed_m_s.any())

    def T_world_rest(self, time_s):
        T = np.eye(4)
        T[:3, 3] = time_s * self._speed_m_s
        return T

    def stiffness_n_m(self, T_rest_touch):
        return K_N_M


def contact_of(scene, organ=None) -> BeamContact:
    return BeamContact(scene.model, organ or Drifting(), damping_n_s_m=2.0, stiffness_n_m=K_N_M, dt_s=DT_S)


@pytest.mark.parametrize("beside_m", [0.001, 0.02])
def test_the_depth_is_that_along_the_beam(scene, beside_m) -> None:
    contact, top_m = contact_of(scene), np.sqrt(BALL_M**2 - beside_m**2)
    for depth_m in (0.003, 0.02, -0.01):
        tip_m = np.add(CENTRE_M, [beside_m, 0.0, top_m - depth_m])
        contact._n_asleep = 0
        force_n = contact.force_along_beam_n(scene.new_data(), tip_m, DOWN, np.zeros(3))
        assert contact.depth_m == pytest.approx(depth_m, abs=2e-4)  # the triangles lie 0.1 mm inside the ball
        assert force_n == pytest.approx(K_N_M * max(contact.depth_m, 0.0))
        np.testing.assert_allclose(contact.T_rest_touch[:3, 3], tip_m - contact.depth_m * DOWN, atol=1e-9)


def test_an_organ_that_comes_up_is_met_as_by_a_tip_that_goes_down(scene) -> None:
    tip_m, data = np.add(CENTRE_M, [0.002, 0.0, BALL_M + 0.001]), scene.new_data()
    rising = contact_of(scene, Drifting((0.0, 0.0, 0.05)))
    rising.time_s = 0.08
    by_organ_n = rising.force_along_beam_n(data, tip_m, DOWN, np.zeros(3))
    still = contact_of(scene)
    by_tip_n = still.force_along_beam_n(data, tip_m + 0.004 * DOWN, DOWN, 0.05 * DOWN)
    assert by_organ_n == pytest.approx(by_tip_n, rel=1e-6)
    assert by_organ_n == pytest.approx(K_N_M * still.depth_m + 2.0 * 0.05)


class Plane:
    """The contact of a tip that is where it is sent with a plane, whose spring may change along it."""

    def __init__(self, gap_m, springs_n_m=(K_N_M,)) -> None:
        self._gap_m, self._springs = gap_m, list(springs_n_m)
        self.stiffness_n_m, self.time_s = 50.0, 0.0
        self.organ = Asked(self)
        self.depth_m, self.force_n, self.T_rest_touch, self.forces_n = -np.inf, 0.0, np.eye(4), []

    def spring_n_m(self):
        spring = self._springs.pop(0) if len(self._springs) > 1 else self._springs[0]
        if spring is None:
            raise TissueError("too aslant")
        return spring

    def sent(self, along_m) -> None:
        self.depth_m = along_m - self._gap_m
        self.force_n = self.stiffness_n_m * max(self.depth_m, 0.0)
        self.forces_n.append(self.force_n)


class Asked:
    """Asks a plane for its spring by the name that an organ has for it."""

    is_moving = False

    def __init__(self, plane) -> None:
        self._plane = plane

    def stiffness_n_m(self, T_rest_touch):
        return self._plane.spring_n_m()


def pressed(plane, *, end_m=0.06, search_m=0.03, force_n=0.5) -> tuple[ForceControl, np.ndarray]:
    """The control of a joint that slides along the beam, and where it was sent [m]."""
    line = BeamLine(-0.04, np.arange(-0.04, end_m + 1e-9, FINE_M)[:, None], "The joint ends there.")
    goal = ForceGoal(force_n=force_n, search_m=search_m, speed_m_s=0.05, settle_s=0.2)
    control, places_m = ForceControl(line, plane, goal, dt_s=DT_S), []
    for q, _ in control.commands():
        plane.sent(q[0])
        places_m.append(q[0])
    return control, np.array(places_m)


def test_the_force_comes_near_the_wanted_one_exponentially_and_no_further() -> None:
    plane = Plane(0.005)
    control, places_m = pressed(plane)
    forces_n = np.array(plane.forces_n)
    assert not control.reason
    assert control.held_s == pytest.approx(0.2)
    assert forces_n[-1] == pytest.approx(0.5, rel=1e-4)
    assert forces_n.max() < 0.5 * 1.001
    assert np.abs(np.diff(places_m)).max() <= 0.05 * DT_S * (1.0 + 1e-9)
    # Where the speed limit no longer binds, what is missing falls by (1 - dt / tau) each step.
    missing = 0.5 - forces_n
    free = np.flatnonzero((missing < 0.8 * 0.05 * K_N_M * TIME_CONSTANT_S) & (missing > 1e-4))
    shares = missing[free[1:]] / missing[free[:-1]]
    np.testing.assert_allclose(shares, 1.0 - DT_S / TIME_CONSTANT_S, atol=1e-3)


@pytest.mark.parametrize(
    ("plane", "more", "reason"),
    [
        (Plane(0.04), {}, "met no organ from 40 mm above to 30 mm below"),
        (Plane(0.02), {"end_m": 0.01}, "met no organ from 40 mm above to 10 mm below.*The joint ends there"),
        (Plane(-0.05), {}, "come down from within"),
        (Plane(0.0), {"end_m": 0.003}, r"pressed with 0\.27 N, 3\.0 mm below the surface, where 0\.5 N were wanted"),
        (Plane(0.0, [None]), {}, "does not yield to the probe there: too aslant"),
    ],
)  # fmt: skip
def test_what_keeps_it_from_the_force_is_told(plane, more, reason) -> None:
    control, _ = pressed(plane, **more)
    assert re.search(reason, control.reason)


def test_where_the_face_has_slid_to_another_spring_it_is_pressed_anew() -> None:
    plane = Plane(0.0, [90.0, 60.0])
    control, places_m = pressed(plane)
    assert plane.stiffness_n_m == 60.0
    assert places_m[-1] == pytest.approx(0.5 / 60.0, rel=1e-3)
    assert control.held_s == pytest.approx(0.4)

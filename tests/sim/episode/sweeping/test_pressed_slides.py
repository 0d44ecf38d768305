"""Sweeps under servos: the force is held along the way, by the face alone, and the arm flies on from where it ended."""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from geom_surface import geom_triangles, least_signed_distances_m
from sparse_sphere import nearest, sparse

from sim.episode.moving.motion import Motion, Phase, set_state
from sim.episode.setup import Setup
from sim.episode.sweeping.ground import ground_of
from sim.episode.sweeping.making import make_sweep_motion
from sim.episode.sweeping.motion import SweepMotion
from sim.episode.sweeping.settings import SweepSettings
from sim.world.motion.settings import MotionSettings, ServoSettings
from sim.world.solids.surface_distance import SurfaceDistance

PRESS_N, SOFT_N_M, STIFF_N_M = 2.0, 87.0, 5000.0
PLACES_M = ((-0.05, -0.05), (0.02, -0.04), (0.05, 0.05))
Run = tuple[Setup, float, list[Motion]]


def pressing(setup: Setup, stiffness_n_m: float) -> SweepMotion:
    servo = ServoSettings(press_n=PRESS_N, stiffness_n_m=stiffness_n_m)
    return make_sweep_motion(ground_of(setup), "servo", SweepSettings(), MotionSettings(), servo)


@pytest.fixture(scope="module")
def setup(sphere_arm_setup) -> Setup:
    return sparse(sphere_arm_setup)


@pytest.fixture(scope="module", params=[SOFT_N_M, STIFF_N_M])
def run(setup, request) -> Run:
    """A landing and two long slides, on a soft spring and on a stiff one."""
    model, data = pressing(setup, request.param), setup.scene.new_data()
    return setup, request.param, [model.move(data, nearest(setup, *place)) for place in PLACES_M]


def slides_of(motions: list[Motion]) -> list[Motion]:
    return [motion for motion in motions if (motion.phases == Phase.SWEEP).all()]


def depth_along_beam_m(triangles_m: np.ndarray, tip_m: np.ndarray, beam: np.ndarray) -> float:
    """How far a tip is beyond the first triangle that its beam enters, by Moeller and Trumbore [m]."""
    a, ab, ac = (
        triangles_m[:, 0],
        triangles_m[:, 1] - triangles_m[:, 0],
        triangles_m[:, 2] - triangles_m[:, 0],
    )
    start_m = tip_m - 0.06 * beam
    p = np.cross(beam, ac)
    size = np.einsum("ij,ij->i", ab, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ij,ij->i", start_m - a, p) / size
        q = np.cross(start_m - a, ab)
        v, t = q @ beam / size, np.einsum("ij,ij->i", ac, q) / size
    enters = (size > 0.0) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)
    return 0.06 - float(t[enters].min())


def test_the_force_is_held_along_the_way(run) -> None:
    setup, stiffness_n_m, motions = run
    slides = slides_of(motions)
    assert len(slides) == 2
    triangles_m = setup.organ.vertices_m[setup.organ.faces]
    data, depths_m = setup.scene.new_data(), list[float]()
    for motion in slides:
        assert motion.contact_path_m > 0.05
        for state in motion.states[::5]:
            set_state(data, state)
            tip = data.site(setup.scene.tip_site)
            depths_m.append(depth_along_beam_m(triangles_m, tip.xpos, tip.xmat.reshape(3, 3)[:, 2]))
    # The spring alone, by the test's own rays; the damper has 2 N s/m times some mm/s along the beam.
    forces_n = stiffness_n_m * np.array(depths_m)
    assert (np.abs(forces_n - PRESS_N) <= 0.2 * PRESS_N).mean() >= 0.95
    for motion in slides:
        held = motion.held
        assert held is not None
        assert (held.force_in_band or 0.0) >= 0.95
        assert held.force_n.max() <= 1.5 * PRESS_N
        assert held.slip_m.max() < 0.002


def test_servos_slide_within_limits_and_touch_with_the_face_alone(run) -> None:
    setup, _, motions = run
    model, data = setup.scene.model, setup.scene.new_data()
    low, high = model.jnt_range.T
    for motion in motions:
        assert ((motion.states >= low - 1e-3) & (motion.states <= high + 1e-3)).all()
        tip_m_s = np.linalg.norm(np.diff(motion.tips_m, axis=0), axis=1) / np.diff(motion.time_s)
        on = motion.phases == Phase.SWEEP
        # The commands keep to 40 mm/s; where a joint turns fast, the servos lag by 0.3 mm and catch up in 20 ms or so.
        assert tip_m_s[on[1:]].max(initial=0.0) <= 0.04 + 0.0003 / 0.02
        for state in motion.states[::10]:
            data.qpos[:] = state
            mujoco.mj_forward(model, data)
            assert not [contact for contact in data.contact[: data.ncon] if contact.dist < 0.0]


def test_nothing_but_the_face_comes_into_an_organ_that_gives_way_under_it(run) -> None:
    """Against the true triangles, with the arm lifted along the beam by as much as the organ has given way."""
    setup, stiffness_n_m, motions = run
    scene, data = setup.scene, setup.scene.new_data()
    exact = SurfaceDistance(setup.organ)
    states = np.vstack([motion.states[::60] for motion in slides_of(motions)])
    assert len(states) > 4
    for geom in sorted(scene.arm_geoms):
        own_m = geom_triangles(scene.model, geom)
        world_m, tips_m = np.empty((len(states), *own_m.shape)), np.empty((len(states), 3))
        for row, state in enumerate(states):
            set_state(data, state)
            tip = data.site(scene.tip_site)
            up_m = -PRESS_N / stiffness_n_m * tip.xmat.reshape(3, 3)[:, 2]
            world_m[row] = data.geom_xpos[geom] + own_m @ data.geom_xmat[geom].reshape(3, 3).T + up_m
            tips_m[row] = tip.xpos + up_m
        least_m = least_signed_distances_m(world_m, exact, ignored_at_m=tips_m, ignored_m=0.0085)
        assert least_m.min() > -5e-4  # the distance grid's error at a rim


def test_servos_go_on_from_where_a_slide_ended_and_lift_off_from_there(setup) -> None:
    model, data = pressing(setup, SOFT_N_M), setup.scene.new_data()
    first, second = nearest(setup, -0.02, 0.0), nearest(setup, 0.02, 0.0)
    motions = [model.move(data, first), model.move(data, second), model._inner.move(data, first)]
    assert [motion.is_done for motion in motions] == [True, True, True]
    for before, later in pairwise(motions):
        # The first state that is recorded is 10 ms on.
        np.testing.assert_allclose(later.states[0], before.states[-1], atol=2e-3)
    flown = motions[-1]
    assert flown.n_lift_offs == 1
    assert flown.contact_force_n == pytest.approx(PRESS_N, rel=0.02)
    assert np.abs(np.diff(flown.states, axis=0)).max() < 0.05


def test_servos_without_a_force_are_refused(setup) -> None:
    with pytest.raises(ValueError, match="servos of a sweep hold a force"):
        make_sweep_motion(ground_of(setup), "servo", SweepSettings(), MotionSettings(), ServoSettings())

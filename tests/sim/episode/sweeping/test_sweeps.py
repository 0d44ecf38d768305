"""Sweeps: what is read on the way, and a probe that keeps to the organ and to the arm's limits in every state."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

import mujoco
import numpy as np
import pytest
from geom_surface import geom_triangles, least_signed_distances_m
from planted_run import ball
from sparse_sphere import nearest, sparse

from planner import Planner, Situation
from planner.paths.roadmap import Roadmap
from sim.episode.episode import Episode
from sim.episode.moving.motion import Phase
from sim.episode.setup import Setup
from sim.episode.sweeping.ground import Ground, ground_of
from sim.episode.sweeping.making import make_sweep_motion
from sim.episode.sweeping.motion import SweepMotion, set_state
from sim.episode.sweeping.settings import SweepSettings
from sim.world.anatomy.structures import Structure
from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.settings import MotionKind, MotionSettings
from sim.world.solids.surface_distance import SurfaceDistance

SETTINGS = SweepSettings(speed_m_s=0.04, read_every_m=0.01)
SPEEDS = MotionSettings()
STANDOFF_M = 0.04


@dataclass(frozen=True)
class Fixed(Planner):
    """Goes to some poses one after the other."""

    needs_belief: ClassVar[bool] = False
    poses: tuple[int, ...] = ()

    def rank(self, situation: Situation) -> Iterator[int]:
        return (pose for pose in self.poses if pose not in situation.sensed)


def sweep(setup: Setup, kind: MotionKind = "none", settings: SweepSettings = SETTINGS) -> SweepMotion:
    return make_sweep_motion(ground_of(setup), kind, settings, SPEEDS)


@pytest.fixture(scope="module")
def sparse_setup(sphere_setup) -> Setup:
    """The free probe on fewer poses of `sphere`."""
    return sparse(sphere_setup)


@pytest.fixture(scope="module")
def sparse_arm_setup(sphere_arm_setup) -> Setup:
    """The arm on fewer poses of `sphere`."""
    return sparse(sphere_arm_setup)


@pytest.fixture(scope="module")
def arm_slides(sparse_arm_setup) -> list:
    """Motions of the arm over the organ, by way of poses far apart."""
    model, data = sweep(sparse_arm_setup, "kinematic"), sparse_arm_setup.scene.new_data()
    places = ((-0.05, -0.05), (0.02, -0.04), (0.05, 0.05), (-0.04, 0.03))
    return [model.move(data, nearest(sparse_arm_setup, *place)) for place in places]


def test_a_tumour_between_two_poses_is_seen_by_the_path_alone(sparse_setup) -> None:
    start, end, middle = (nearest(sparse_setup, x, 0.0) for x in (-0.045, 0.045, 0.0))
    below = sparse_setup.workspace
    centre_m = below.positions_m[middle] + 0.03 * below.normals[middle]
    setup = replace(sparse_setup, given_tumours=(ball(tuple(centre_m), 0.006),))
    planner = Fixed((start, end))
    stopping = Episode(setup, planner, seed=0)
    assert [step.sensed_fraction for step in stopping.steps(2)] == [0.0, 0.0]
    gliding = Episode(setup, planner, seed=0, motion_model=sweep(setup))
    first, second = gliding.steps(2)
    assert first.sensed_fraction == 0.0
    assert second.sensed_fraction > 0.5
    assert second.reading.is_occupied.sum() > 3
    # The map has it too, where it lies.
    best_m = setup.search_points_m[np.argmax(gliding.prediction.score)]
    assert np.linalg.norm(best_m - centre_m) < 0.012
    assert len(gliding.readings) == len(gliding.sensed) == 1 + second.sweep.n_readings
    assert gliding.sensed[-1] == end


@pytest.mark.parametrize(
    ("paths", "told"),
    [
        (7, r"Fixed\.paths returned 7; it must yield or return paths"),
        ([()], r"Fixed named the path \(\); a path is a tuple of at least one index"),
        ([3], "Fixed named the path 3"),
        ([(10**6, 3)], r"Fixed named the pose 1000000; poses are whole numbers from 0 to"),
        ([(-1, 3)], "Fixed named the pose -1"),
    ],
)
def test_a_path_of_what_is_no_pose_is_refused(sparse_setup, monkeypatch, paths, told) -> None:
    monkeypatch.setattr(Fixed, "paths", lambda self, situation: paths)
    episode = Episode(sparse_setup, Fixed(), seed=0, tumour_map=None, motion_model=sweep(sparse_setup))
    with pytest.raises(ValueError, match=told):
        list(episode.steps(1))


def test_a_free_probe_stays_on_the_organ_at_its_speed_and_reads_every_so_often(sparse_setup) -> None:
    model, data = sweep(sparse_setup), sparse_setup.scene.new_data()
    exact = SurfaceDistance(sparse_setup.organ)
    poses = [nearest(sparse_setup, *place) for place in ((-0.05, 0.0), (0.05, 0.03), (0.0, -0.05))]
    landing, *slides = [model.move(data, pose) for pose in poses]
    assert landing.passed == (poses[0],)
    assert landing.motion_s == pytest.approx(STANDOFF_M / 0.05 + SPEEDS.sensing_s)
    for motion, pose in zip(slides, poses[1:], strict=True):
        assert (motion.phases == Phase.SWEEP).all()
        # Its own poses lie within 0.2 mm of the organ's triangles.
        assert exact.distance_to_triangles_m(motion.tips_m).max() < 3e-4
        speed = np.linalg.norm(np.diff(motion.tips_m, axis=0), axis=1) / np.diff(motion.time_s)
        np.testing.assert_allclose(speed, 0.04, rtol=1e-6)
        assert motion.contact_path_m == pytest.approx(motion.tip_path_m)
        assert (motion.passed[-1], motion.passed_rows[-1]) == (pose, len(motion.time_s) - 1)
        read_m = 0.04 * motion.time_s[list(motion.passed_rows)]
        gaps_m = np.diff(read_m, prepend=0.0)
        assert gaps_m[:-1].min() >= 0.01 - 1e-9
        assert gaps_m.max() <= 0.017
        set_state(data, motion.states[-1])
        tip = data.site(sparse_setup.scene.tip_site)
        np.testing.assert_allclose(tip.xpos, sparse_setup.workspace.positions_m[pose], atol=1e-9)


def test_the_beam_keeps_within_its_tilt_of_the_surface(sparse_setup) -> None:
    tilt_rad = np.deg2rad(5.0)
    model, data = sweep(sparse_setup, settings=replace(SETTINGS, most_tilt_rad=tilt_rad)), None
    data = sparse_setup.scene.new_data()
    workspace, (start, end) = sparse_setup.workspace, (nearest(sparse_setup, x, -0.03) for x in (-0.06, 0.06))
    model.move(data, start)
    motion = model.move(data, end)
    for state in motion.states[::5]:
        set_state(data, state)
        tip = data.site(sparse_setup.scene.tip_site)
        near = np.argsort(np.linalg.norm(workspace.positions_m - tip.xpos, axis=1))[:4]
        turn_rad = np.arccos(workspace.normals[near] @ tip.xmat.reshape(3, 3)[:, 2])
        # The normals of the four poses about a place differ by some 2 degrees themselves.
        assert turn_rad.min() <= tilt_rad + np.deg2rad(2.0)


def test_the_arm_slides_within_its_limits_touching_with_the_face_alone(sparse_arm_setup, arm_slides) -> None:
    setup, model = sparse_arm_setup, sparse_arm_setup.scene.model
    limits = JointLimits.of_arm(setup.arm.path, np.zeros(7, dtype=bool))
    exact, data, n_slides = SurfaceDistance(setup.organ), setup.scene.new_data(), 0
    low, high = model.jnt_range.T
    for motion in arm_slides:
        on = motion.phases == Phase.SWEEP
        if not on.any():
            continue
        n_slides += 1
        dt_s = np.diff(motion.time_s)
        assert ((motion.states >= low - 1e-9) & (motion.states <= high + 1e-9)).all()
        speed = np.diff(motion.states, axis=0) / dt_s[:, None]
        assert (np.abs(speed) <= 1.001 * limits.speed).all()
        acceleration = np.diff(speed, axis=0) / ((dt_s[1:] + dt_s[:-1]) / 2.0)[:, None]
        assert (np.abs(acceleration) <= 1.02 * limits.acceleration).all()
        tip_m_s = np.linalg.norm(np.diff(motion.tips_m, axis=0), axis=1) / dt_s
        assert tip_m_s[on[1:]].max() <= 0.04 * 1.005
        for state, tip_m in zip(motion.states[on][::6], motion.tips_m[on][::6], strict=True):
            data.qpos[:] = state
            mujoco.mj_forward(model, data)
            np.testing.assert_allclose(data.site(setup.scene.tip_site).xpos, tip_m, atol=1e-9)
            assert not [contact for contact in data.contact[: data.ncon] if contact.dist < 0.0]
            assert exact.distance_to_triangles_m(tip_m[None])[0] < 6e-4
    assert n_slides == 3


def test_nothing_but_the_face_of_the_probe_comes_into_the_organ_on_a_slide(
    sparse_arm_setup, arm_slides
) -> None:
    """Against the true triangles of arm and organ, by a way of the test's own."""
    scene, data = sparse_arm_setup.scene, sparse_arm_setup.scene.new_data()
    exact = SurfaceDistance(sparse_arm_setup.organ)
    states = np.vstack([motion.states[motion.phases == Phase.SWEEP][::200] for motion in arm_slides])
    assert len(states) > 4
    for geom in sorted(scene.arm_geoms):
        own_m = geom_triangles(scene.model, geom)
        world_m, tips_m = np.empty((len(states), *own_m.shape)), np.empty((len(states), 3))
        for row, state in enumerate(states):
            set_state(data, state)
            world_m[row] = data.geom_xpos[geom] + own_m @ data.geom_xmat[geom].reshape(3, 3).T
            tips_m[row] = data.site(scene.tip_site).xpos
        least_m = least_signed_distances_m(world_m, exact, ignored_at_m=tips_m, ignored_m=0.0085)
        assert least_m.min() > -5e-4  # the distance grid's error at a rim


def test_the_arm_flies_on_from_where_its_slide_ended(sparse_arm_setup, arm_slides) -> None:
    for before, later in pairwise(arm_slides):
        np.testing.assert_allclose(later.states[0], before.states[-1], atol=1e-6)
    model, data = sweep(sparse_arm_setup, "kinematic"), sparse_arm_setup.scene.new_data()
    first, second = nearest(sparse_arm_setup, -0.05, 0.0), nearest(sparse_arm_setup, 0.0, 0.0)
    model.move(data, first)
    slid = model.move(data, second)
    flown = model._inner.move(data, first)
    assert flown.n_lift_offs == 1
    np.testing.assert_allclose(flown.states[0], slid.states[-1], atol=1e-6)
    assert np.abs(np.diff(flown.states, axis=0)).max() < 0.05


def test_the_probe_is_lifted_over_a_no_press_zone_and_where_flying_is_far_shorter(sparse_setup) -> None:
    setup = sparse_setup
    workspace = setup.workspace
    x_m = workspace.positions_m[:, 0] - setup.organ.bounds_m.mean(axis=0)[0]
    wall = ball(tuple(workspace.positions_m[nearest(setup, 0.0, 0.0)]), 0.01)
    zone = Structure(name="wall", solid=wall, is_keepout=True)
    is_kept = (np.abs(x_m) > 0.009) & (zone.distance_m(workspace.positions_m) > 0.004)
    split = replace(
        sparse(setup, np.flatnonzero(is_kept)),
        scenario=replace(setup.scenario, keepout_distance_m=0.004),
        structures=(zone,),
    )
    ground = ground_of(split)
    assert len(np.unique(ground.roadmap.islands)) == 2
    assert re.search(
        r"falls into 2 islands .*: \d+ poses that see \d+%, \d+ poses that see", ground.notices[0]
    )
    model, data = make_sweep_motion(ground, "none", SETTINGS, SPEEDS), setup.scene.new_data()
    left, right = nearest(split, -0.03, 0.0), nearest(split, 0.03, 0.0)
    model.move(data, left)
    over = model.move(data, right)
    assert (over.n_lift_offs, over.contact_path_m, over.passed) == (1, 0.0, (right,))
    # No state on the organ is within the zone, on any slide beside it.
    beside = model.move(data, nearest(split, 0.015, 0.05))
    on_m = beside.tips_m[beside.phases == Phase.SWEEP]
    assert len(on_m) > 3
    assert split.structures[0].distance_m(on_m).min() > 0.004


def test_an_arm_whose_surface_is_one_region_has_one_island(sparse_arm_setup) -> None:
    roadmap: Roadmap = ground_of(sparse_arm_setup).roadmap
    assert np.mean(roadmap.islands == 0) > 0.99
    assert isinstance(ground_of(sparse_arm_setup), Ground)


def test_more_readings_than_the_sensor_makes_are_refused() -> None:
    with pytest.raises(ValueError, match="40 readings a second, and the sensor makes 10"):
        SweepSettings(speed_m_s=0.04, read_every_m=0.001, frame_rate_hz=10.0)

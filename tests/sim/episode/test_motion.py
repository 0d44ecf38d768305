"""Motion: paths touch nothing, keep all limits, and begin and end where they should."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from moved import POSES, motions

from planner import Planner
from sim.episode.episode import Episode
from sim.episode.moving.arm_motion import make_motion_model
from sim.episode.moving.motion import MotionModel, Phase, blocked
from sim.world.motion.joint_limits import JointLimits
from sim.world.motion.path_check import PathCheck
from sim.world.motion.path_search import PathSearch
from sim.world.motion.path_tree import connect_trees
from sim.world.motion.settings import MotionSettings, ServoSettings
from sim.world.solids.surface_distance import SurfaceDistance


@pytest.fixture(scope="module")
def kinematic(sphere_arm_setup):
    return motions(sphere_arm_setup, "kinematic")[0]


@pytest.fixture(scope="module")
def limits(sphere_arm_setup):
    return JointLimits.of_arm(sphere_arm_setup.arm.path, np.zeros(7, dtype=bool))


@pytest.fixture(scope="module")
def exact(sphere_arm_setup):
    """Distances to the organ's triangles."""
    return SurfaceDistance(sphere_arm_setup.organ)


def test_transfers_keep_the_tip_off_the_organ(sphere_arm_setup, kinematic, exact) -> None:
    for motion in kinematic:
        tips_m = motion.tips_m[motion.phases == Phase.TRANSFER]
        assert not sphere_arm_setup.organ.contains(tips_m).any()
        assert exact.distance_to_triangles_m(tips_m[::20]).min() > 0.003


def test_ways_around_are_found_where_the_straight_way_collides(sphere_arm_setup) -> None:
    search = sphere_arm_setup.positioner.search
    check = PathCheck(sphere_arm_setup.scene, search.chain, search.meter, search.clearance)
    paths, rng, n_around = PathSearch(search, check), np.random.default_rng(3), 0
    for _ in range(60):
        start, end = search.starts.q[rng.integers(len(search.starts.q), size=2)]
        if (
            n_around == 2
            or not check.is_free(np.stack([start, start]))
            or not check.is_free(np.stack([end, end]))
        ):
            continue
        if check.is_free(np.stack([start, end])):
            continue
        path = paths.transfer(start, end)
        if not path.is_free:
            assert "penetrates" in path.reason or "close" in path.reason
            continue
        n_around += 1
        np.testing.assert_allclose(path.curves[0](0.0), start, atol=1e-9)
        np.testing.assert_allclose(path.curves[-1](path.curves[-1].x[-1]), end, atol=1e-9)
        for curve in path.curves:
            q = curve(np.linspace(0.0, curve.x[-1], 300))
            state = search.chain.forward(q)
            probe_m, _ = search.clearance.probe_distances(state.tips_m, state.R_world_tip)
            assert search.meter.measure(search.chain.full(q)).is_free.all()
            assert (probe_m >= 0.0).all()
    assert n_around == 2


def test_limits_of_speed_and_acceleration_hold_by_finite_differences(kinematic, limits) -> None:
    for motion in kinematic:
        dt_s = np.diff(motion.time_s)
        assert (dt_s > 0.0).all()
        assert dt_s.max() <= 0.01 + 1e-9
        speed = np.diff(motion.states, axis=0) / dt_s[:, None]
        assert (np.abs(speed) <= limits.speed * 1.001).all()
        middle_s = (dt_s[1:] + dt_s[:-1]) / 2.0
        acceleration = np.diff(speed, axis=0) / middle_s[:, None]
        assert (np.abs(acceleration) <= limits.acceleration * 1.02).all()
        tip_m_s = np.linalg.norm(np.diff(motion.tips_m, axis=0), axis=1) / dt_s
        assert tip_m_s.max() <= 0.25 * 1.005
        slow = (motion.phases[1:] == motion.phases[:-1]) & (motion.phases[1:] != Phase.TRANSFER)
        assert tip_m_s[slow].max() <= 0.05 * 1.005


def test_paths_begin_and_end_where_they_should(sphere_arm_setup, kinematic) -> None:
    positioner, workspace = sphere_arm_setup.positioner, sphere_arm_setup.workspace
    np.testing.assert_array_equal(kinematic[0].states[0], sphere_arm_setup.scene.home_q)
    for before, after in pairwise(kinematic):
        np.testing.assert_allclose(before.states[-1], after.states[0], atol=1e-12)
    for pose, motion in zip(POSES, kinematic, strict=True):
        np.testing.assert_allclose(motion.states[-1], positioner.reach(pose).q, atol=1e-12)
        down_m = motion.tips_m[motion.phases == Phase.DESCEND] - workspace.positions_m[pose]
        normal = workspace.normals[pose]
        assert np.linalg.norm(down_m - np.outer(down_m @ normal, normal), axis=1).max() < 3e-4
        assert -down_m[0] @ normal == pytest.approx(0.04, abs=5e-4)


def test_the_same_poses_give_the_same_bytes(sphere_arm_setup, kinematic) -> None:
    again, _ = motions(sphere_arm_setup, "kinematic", POSES[:3])
    assert all(a.states.tobytes() == b.states.tobytes() for a, b in zip(kinematic, again, strict=False))


def test_sensing_the_same_pose_again_lifts_and_comes_back(sphere_arm_setup) -> None:
    (first, second), _ = motions(sphere_arm_setup, "kinematic", (7_000, 7_000))
    assert (
        set(second.phases.tolist()) == {Phase.LIFT, Phase.DESCEND, Phase.TRANSFER} or second.tip_path_m < 0.09
    )
    assert second.tip_path_m == pytest.approx(0.08, abs=1e-3)
    np.testing.assert_allclose(first.states[-1], second.states[-1], atol=1e-12)


def test_jumps_cost_less_time_than_paths_and_not_much(sphere_arm_setup, kinematic) -> None:
    jumps, _ = motions(sphere_arm_setup, "none")
    for jump, motion in zip(jumps, kinematic, strict=True):
        assert 0.3 * motion.motion_s < jump.motion_s <= motion.motion_s * 1.02
        assert jump.tip_path_m <= motion.tip_path_m * 1.001  # stations are joined by straight lines


def test_slower_joints_take_longer(sphere_arm_setup, kinematic) -> None:
    settings = MotionSettings(joint_speed=0.2, joint_acceleration=0.5)
    slow, _ = motions(sphere_arm_setup, "kinematic", POSES[:2], settings=settings)
    for motion, usual in zip(slow, kinematic, strict=False):
        assert motion.motion_s > usual.motion_s
        speed = np.diff(motion.states, axis=0) / np.diff(motion.time_s)[:, None]
        assert np.abs(speed).max() <= 0.2 * 1.001


@pytest.mark.parametrize(("distance", "wanted_s"), [(0.0, 0.0), (0.25, 1.0), (1.0, 2.0), (3.0, 4.0)])
def test_rest_to_rest_is_the_trapezoid(distance, wanted_s) -> None:
    # speed 1, acceleration 1: below 1 a triangle of 2 sqrt(d), above it d + 1
    limits = JointLimits(np.ones(1), np.ones(1))
    assert limits.rest_to_rest_s(np.array([distance])) == pytest.approx([wanted_s])


def test_the_gaps_prove_what_dense_sampling_finds(sphere_arm_setup) -> None:
    search = sphere_arm_setup.positioner.search
    check = PathCheck(sphere_arm_setup.scene, search.chain, search.meter, search.clearance)
    rng = np.random.default_rng(0)
    verdicts = []
    for _ in range(80):
        start, end = search.starts.q[rng.integers(len(search.starts.q), size=2)]
        line = np.linspace(start, end, 150)
        clearances, state = search.meter.measure(search.chain.full(line)), search.chain.forward(line)
        probe_m, _ = search.clearance.probe_distances(state.tips_m, state.R_world_tip)
        hit = check.first_hit(np.stack([start, end]))
        verdicts.append(hit is None)
        if hit is None:
            assert clearances.is_free.all()
            assert (probe_m >= 0.0).all()
    assert 3 < sum(verdicts) < len(verdicts) - 3


def test_no_point_of_the_arm_moves_farther_than_its_levers_say(sphere_arm_setup) -> None:
    search, scene = sphere_arm_setup.positioner.search, sphere_arm_setup.scene
    check = PathCheck(scene, search.chain, search.meter, search.clearance)
    rng, data = np.random.default_rng(1), scene.new_data()
    for _ in range(50):
        q = rng.uniform(*search.chain.search_range())
        step = rng.normal(size=7) * 0.02
        places_m = []
        for each in (q, q + step):
            data.qpos[:] = search.chain.full(each)
            mujoco.mj_kinematics(scene.model, data)
            places_m.append([*data.geom_xpos[sorted(scene.arm_geoms)], data.site(scene.tip_site).xpos.copy()])
        moved_m = np.linalg.norm(np.diff(places_m, axis=0)[0], axis=1).max()
        assert moved_m <= check.motion_m(q, q + step) + 1e-12


def test_trees_find_the_gap_in_a_wall_and_say_when_there_is_none() -> None:
    samples = np.random.default_rng(0).uniform(-2.0, 2.0, (500, 2))

    def is_free(a, b, *, gap=0.5):
        points = np.linspace(a, b, 50)
        return not ((np.abs(points[:, 0]) < 0.1) & (np.abs(points[:, 1] - 1.5) > gap / 2)).any()

    start, end = np.array([-1.0, -1.0]), np.array([1.0, -1.0])
    path = connect_trees(start, end, is_free, samples)
    assert path is not None
    np.testing.assert_array_equal(path[[0, -1]], [start, end])
    assert all(is_free(a, b) for a, b in pairwise(path))
    assert connect_trees(start, end, lambda a, b: is_free(a, b, gap=0.0), samples) is None


class BlockedMotion(MotionModel):
    """Finds no way to some poses."""

    def __init__(self, motion_model: MotionModel, is_blocked: set[int]) -> None:
        self._motion_model, self._is_blocked = motion_model, is_blocked

    def move(self, data, pose):
        if pose in self._is_blocked:
            return blocked(
                "No free path leads to the pose: going straight, elbow penetrates table (-3.0 mm)."
            )
        return self._motion_model.move(data, pose)


def test_a_pose_without_a_path_is_skipped_with_the_pair(sphere_setup) -> None:
    class Listed(Planner):
        needs_belief = False

        def rank(self, situation):
            return iter(pose for pose in range(4) if situation.available(exclude_sensed=True)[pose])

    motion_model = BlockedMotion(make_motion_model(sphere_setup), {0, 2})
    episode = Episode(
        sphere_setup, Listed(), seed=0, motion_model=motion_model, sensing_s=1.5, tumour_map=None
    )
    steps = list(episode.steps(9))
    assert [step.pose_index for step in steps] == [1, 3]
    assert {pose: "elbow penetrates table" in episode.skipped[pose].reason for pose in (0, 2)} == {
        0: True,
        2: True,
    }
    assert all(step.procedure_s == pytest.approx(step.motion.motion_s + 1.5) for step in steps)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (lambda: MotionSettings(tip_speed_m_s=float("nan")), "tip_speed_m_s=nan"),
        (lambda: MotionSettings(joint_speed=0.0), "joint_speed=0.0"),
        (lambda: MotionSettings(sensing_s=-1.0), "sensing_s=-1.0"),
        (lambda: ServoSettings(stiffness_n_m=float("inf")), "stiffness_n_m=inf"),
        (lambda: ServoSettings(press_m=0.1), "press_m=0.1"),
        (lambda: ServoSettings(settle_s=float("nan")), "settle_s=nan"),
    ],
)
def test_settings_out_of_range_are_refused(settings, message) -> None:
    with pytest.raises(ValueError, match=message):
        settings()


def test_other_arms_get_the_stated_limits(sphere_arm_setup, tmp_path) -> None:
    limits = JointLimits.of_arm(tmp_path / "ur5e.xml", np.array([False, True]))
    np.testing.assert_array_equal(limits.speed, [1.0, 0.25])
    np.testing.assert_array_equal(limits.acceleration, [4.0, 1.0])


def test_an_arm_whose_home_touches_something_starts_at_the_first_stand_off(sphere_arm_setup) -> None:
    scene = sphere_arm_setup.scene
    sunk_q = scene.home_q.copy()
    sunk_q[1] = 1.7  # bent forward, through the table
    search = sphere_arm_setup.positioner.search
    home_q = search.chain._home_q
    try:
        search.chain._home_q = sunk_q
        (motion,), _ = motions(replace(sphere_arm_setup), "kinematic", POSES[2:3])
    finally:
        search.chain._home_q = home_q
    assert motion.is_done
    assert set(motion.phases.tolist()) == {Phase.DESCEND}

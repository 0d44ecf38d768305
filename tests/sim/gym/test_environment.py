"""An environment of Gymnasium is an episode: the same truth, the same map, what is sensed and what is out of reach."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from planner import make_planner
from sim.episode.episode import Episode
from sim.errors import UsageError
from sim.running.config import EpisodeConfig
from sim.running.fields import changed
from sim.running.parts import make_parts
from sim.world.errors import MissingPackageError
from sim.world.optional import optional_module

gymnasium = pytest.importorskip("gymnasium", reason="needs pip install 'sounding[gym]'")
check_env = import_module("gymnasium.utils.env_checker").check_env
vector = import_module("gymnasium.vector")
sim_gym = import_module("sim.gym")

POSES = (7000, 5000, 7031, 120)
SMALL = {"keeps_map": False, "max_steps": 4}


def environment(scenario="sphere", **options):
    """A bare environment, without Gymnasium's wrappers."""
    return gymnasium.make(f"Sounding/{scenario}-v0", **options).unwrapped


@pytest.mark.parametrize("name", sim_gym.ENVIRONMENTS)
def test_every_name_is_registered(name):
    assert gymnasium.spec(name).kwargs == {"scenario": name.removeprefix("Sounding/").removesuffix("-v0")}


def test_registering_twice_changes_nothing():
    before = dict(gymnasium.registry)
    sim_gym.register_environments()
    assert gymnasium.registry == before


def test_gymnasium_finds_no_fault_without_a_map():
    check_env(environment(**SMALL))


def test_gymnasium_finds_no_fault_with_a_map():
    check_env(environment(max_steps=3))


def test_a_map_and_what_is_sensed_are_those_of_an_episode():
    env = environment(max_steps=len(POSES))
    first, info = env.reset(seed=3)
    assert info["seed"] == 3
    parts = make_parts(changed(EpisodeConfig(), scenario="sphere", arm="none", seed=3))
    chosen = sim_gym.chosen_pose.ChosenPose()
    episode = Episode(env.episode.setup, chosen, seed=3, map_settings=parts.map_settings, detail=parts.detail)
    np.testing.assert_array_equal(env.episode.truth.is_tumour, episode.truth.is_tumour)
    assert first["belief"].shape == episode.setup.query.shape
    steps = episode.steps(len(POSES))
    for pose in POSES:
        chosen.pose = pose
        step, (observation, _, _, _, info) = next(steps), env.step(pose)
        assert info["sensed_fraction"] == step.sensed_fraction
        belief = episode.setup.on_lattice(episode.prediction.probability, outside=0.0)
        np.testing.assert_array_equal(observation["belief"], belief.astype(np.float32))


def test_readings_without_a_map_are_those_with_one():
    poses = {}
    for keeps_map in (True, False):
        env = environment(keeps_map=keeps_map, makes_readings=True, max_steps=len(POSES))
        env.reset(seed=3)
        observation = [env.step(pose)[0] for pose in POSES][-1]
        assert ("belief" in observation) is keeps_map
        readings = env.situation().readings
        points_m = np.concatenate([each.points_m for each in readings])
        labels = np.concatenate([each.is_occupied for each in readings])
        poses[keeps_map] = (points_m, labels, observation["tumour_in_cone"])
    for with_map, without in zip(poses[True], poses[False], strict=True):
        np.testing.assert_array_equal(with_map, without)
    env = environment(**SMALL)
    env.reset(seed=3)
    env.step(POSES[0])
    assert not len(env.situation().readings[0].points_m)


def test_a_planner_that_is_shown_the_situation_acts_as_in_an_episode():
    env = environment(keeps_map=False, makes_readings=True, max_steps=5)
    env.reset(seed=3)
    planner = make_planner("trained")
    chosen = [next(iter(planner.rank(env.situation())))]
    while not (ended := env.step(chosen[-1]))[2] and not ended[3]:
        chosen.append(next(iter(planner.rank(env.situation()))))
    steps = Episode(env.episode.setup, planner, seed=3, tumour_map=None).steps(5, until_sensed=0.95)
    assert [step.pose_index for step in steps] == chosen


def test_the_observation_tells_the_course_of_the_episode():
    env = environment(**SMALL)
    observation, _ = env.reset(seed=0)
    assert observation["last_pose"] == -1
    assert observation["action_mask"].all()
    for pose in POSES[:2]:
        observation, *_ = env.step(pose)
    assert observation["history"].tolist() == [*POSES[:2], -1, -1]
    assert observation["last_pose"] == POSES[1]
    assert observation["share_used"] == pytest.approx(0.5)
    assert np.flatnonzero(observation["action_mask"] == 0).tolist() == sorted(POSES[:2])
    assert "belief" not in observation


def coarse(folder, base):
    """The file of a named scenario with few poses and a coarse lattice, which is built fast."""
    file = folder / "coarse.toml"
    file.write_text(f'base = "{base}"\nn_poses = 300\nscore_spacing_m = 0.008\n')
    return str(file)


def pose_above(env):
    """The pose whose cone holds most of the first tumour, found by looking at the truth."""
    setup, anatomy = env.episode.setup, env.episode.truth.anatomy
    centre_m = anatomy.detection_points_m[anatomy.detection_tumours == 0].mean(axis=0)
    return int(np.argmin(setup.workspace.angles_to_rad(centre_m)))


def test_the_reward_is_what_is_newly_sensed_and_a_bonus_for_each_tumour_met():
    env = environment("spheres", keeps_map=False, max_steps=3, reward_per_tumour=10.0)
    env.reset(seed=0)
    pose = pose_above(env)
    observation, reward, _, _, info = env.step(pose)
    assert observation["tumour_in_cone"].tolist() == [1, 0, 0]
    assert info["tumours_met"] >= 1
    assert reward == pytest.approx(info["sensed_fraction"] + 10.0 * info["tumours_met"])
    observation, again, _, _, _ = env.step(pose)
    assert again == 0.0
    assert observation["tumour_in_cone"].tolist() == [1, 1, 0]


def test_an_episode_is_terminated_at_95_percent_and_truncated_at_the_last_step():
    env = environment(**SMALL | {"max_steps": 60})
    env.reset(seed=0)
    anatomy, cone = env.episode.truth.anatomy, env.episode.setup.cone
    workspace, left_m = env.episode.setup.workspace, anatomy.detection_points_m
    is_terminated = False
    while not is_terminated:
        pose = int(np.argmin(workspace.angles_to_rad(left_m[0])))
        left_m = left_m[~cone.contains(left_m, workspace.positions_m[pose], workspace.normals[pose])]
        _, _, is_terminated, is_truncated, info = env.step(pose)
        assert not is_truncated
    assert info["sensed_fraction"] >= 0.95
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)
    env = environment(**SMALL)
    env.reset(seed=0)
    ends = [env.step(0)[3] for _ in range(4)]
    assert ends == [False, False, False, True]
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)


def test_what_a_sweep_reads_on_the_way_counts():
    seen = {}
    for makes_readings in (False, True):
        env = environment(**SMALL, sense="sweep", makes_readings=makes_readings, reward_per_tumour=10.0)
        env.reset(seed=3)
        env.step(9000)
        # Between these two poses lies the tumour, which the cone at neither end holds.
        observation, reward, _, _, info = env.step(2000)
        assert reward == pytest.approx(10.0 + info["sensed_fraction"])
        seen[makes_readings] = (info["tumours_met"], observation["tumour_in_cone"].tolist())
    assert seen[False] == seen[True] == (1, [0, 1, 0, 0])


def test_a_sweep_shows_what_planners_of_paths_need():
    env = environment(**SMALL, sense="sweep")
    env.reset(seed=3)
    env.step(5)
    situation = env.situation()
    assert situation.roadmap is not None
    assert situation.read_every_m > 0.0
    assert all(0 <= pose < 14_400 for pose in next(iter(make_planner("boustrophedon").paths(situation))))


def test_a_pose_out_of_reach_is_a_step_without_a_reading(tmp_path):
    env = sim_gym.SoundingEnv(coarse(tmp_path, "liver"), arm="default", **SMALL)
    observation, _ = env.reset(seed=0)
    lost = int(np.argmin(observation["action_mask"]))
    assert observation["action_mask"][lost] == 0
    assert env.situation().skipped == set(np.flatnonzero(observation["action_mask"] == 0))
    observation, reward, _, _, info = env.step(lost)
    assert (reward, info["is_reached"], observation["last_pose"]) == (0.0, False, -1)
    assert info["reason"] == env.episode.setup.positioner.reach(lost).explain()
    assert observation["share_used"] == pytest.approx(0.25)
    reached = int(np.argmax(observation["action_mask"]))
    assert env.step(reached)[4]["is_reached"]


def test_an_organ_without_tumours_gives_no_reward_and_no_end():
    env = environment(n_tumours=0, **SMALL)
    env.reset(seed=0)
    _, reward, is_terminated, _, info = env.step(7000)
    assert (reward, is_terminated, info["sensed_fraction"], info["tumours_met"]) == (0.0, False, 0.0, 0)


def test_an_organ_for_which_there_is_no_room_is_told_by_its_seed():
    course = environment(**SMALL).course
    tight = replace(course, lattice_shape=(22, 22, 12))
    with pytest.raises(UsageError, match=r"seed=0: .* 14400 poses and .* room for 14400 and \(22, 22, 12\)"):
        tight.setup_of(course.parts)


def test_generated_livers_differ_in_arrays_of_one_size(tmp_path):
    env = sim_gym.SoundingEnv(coarse(tmp_path, "generated-liver"), max_steps=2)
    for seed in (0, 1):
        observation, info = env.reset(seed=seed)
        assert env.observation_space.contains(observation)
        n_poses = env.episode.setup.workspace.n_poses
        assert observation["action_mask"].sum() == n_poses < env.action_space.n
        assert not info["poses"][n_poses:].any()
        x, y, z = env.episode.setup.query.shape
        assert observation["belief"][:x, :y, :z].sum() == pytest.approx(observation["belief"].sum())
    info = env.step(env.action_space.n - 1)[4]
    assert not info["is_reached"]
    assert str(n_poses) in info["reason"]


@pytest.mark.parametrize("kind", ["SyncVectorEnv", "AsyncVectorEnv"])
def test_several_run_side_by_side(kind):
    def make():
        return gymnasium.make("Sounding/sphere-v0", **SMALL)

    several = getattr(vector, kind)([make, make])
    try:
        _, info = several.reset(seed=[4, 5])
        assert info["seed"].tolist() == [4, 5]
        for _ in range(5):  # past the end of the first episodes
            observation, reward, *_ = several.step(np.array([7000, 5000]))
        assert observation["action_mask"].shape == (2, 14_400)
        assert np.isfinite(reward).all()
    finally:
        several.close()


def test_without_a_seed_the_stream_of_the_first_one_goes_on():
    env = environment(**SMALL)
    draws = []
    for _ in range(2):
        env.reset(seed=7)
        draws.append([env.reset()[1]["seed"] for _ in range(3)])
    assert draws[0] == draws[1]
    assert len(set(draws[0])) == 3


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"seed": 3}, r"seed=3: .*reset"),
        ({"motion": "servo"}, "motion=servo: "),
        ({"max_steps": 0}, "max_steps=0: must be a whole number, 1 or more"),
        ({"max_steps": 2.5}, "max_steps=2.5: must be a whole number, 1 or more"),
        ({"reward_per_tumour": np.nan}, "reward_per_tumour=nan: must be a finite number"),
        ({"out": "folder"}, "out=folder: is no option of an environment. Nothing is written"),
        ({"frames": "each"}, "frames=each: is no option of an environment"),
        ({"config": "config.json"}, "config=config.json: .* by their names"),
        ({"keeps_map": False, "map": "my_map:Map"}, "map=my_map:Map: no map is kept"),
        ({"keeps_map": False, "sensor": "cone-with-errors"}, "sensor=cone-with-errors: no readings are made"),
        ({"map": "when-needed", "planner": "random"}, "map=when-needed: keeps no map here"),
        ({"makes_readings": False}, "makes_readings=False: a map is made of readings"),
        ({"stepz": 3}, "unknown option 'stepz'"),
    ],
)
def test_what_an_environment_does_not_take_is_refused_with_the_remedy(options, text):
    with pytest.raises(UsageError, match=text):
        sim_gym.SoundingEnv("sphere", **options)


def test_an_action_that_is_none_is_refused():
    env = environment(**SMALL)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"action=14400: must be 0 .. 14399"):
        env.step(14_400)
    for action in (3.7, True, np.True_, "3"):
        with pytest.raises(ValueError, match=r"must be a whole number, 0 .. 14399"):
            env.step(action)
    assert env.step(np.int64(3))[4]["is_reached"]


def test_without_gymnasium_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(MissingPackageError, match=r"`sim.gym` needs gymnasium"):
        optional_module("gymnasium", "gym", "`sim.gym`")

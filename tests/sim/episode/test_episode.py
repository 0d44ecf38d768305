"""The loop: laws that every episode obeys, whatever the planner."""

from __future__ import annotations

import signal
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mapping import MapSettings
from planner import Planner, make_planner, planner_names
from sim.episode.episode import Episode
from sim.episode.positioner import Positioner
from sim.episode.setup import Setup
from sim.errors import UsageError
from sim.running.fields import config_of, recorded
from sim.running.output import Output
from sim.running.parts import make_parts
from sim.running.run_episode import record_episode
from sim.world.ik.result import IkResult, IkStatus

PAPER_MAP = MapSettings.paper()


def run(setup: Setup, planner: Planner, *, seed: int = 0, n: int = 5, **more) -> tuple[Episode, list]:
    episode = Episode(setup, planner, seed=seed, map_settings=PAPER_MAP, **more)
    return episode, list(episode.steps(n))


def test_the_setup_is_the_papers(sphere_setup) -> None:
    assert sphere_setup.workspace.n_poses == 14_400
    assert int(sphere_setup.hinge_mask.sum()) == 2_890
    assert sphere_setup.query.n_points == 6_292
    assert sphere_setup.organ.contains(sphere_setup.search_points_m).all()
    low_m, high_m = sphere_setup.organ.bounds_m
    np.testing.assert_allclose((low_m + high_m)[:2] / 2, [0.5, 0.0], atol=1e-9)
    assert low_m[2] == pytest.approx(0.0, abs=1e-9)


def test_sensed_fraction_never_falls_and_equals_the_cones_union(sphere_setup) -> None:
    episode, steps = run(sphere_setup, make_planner("multi-resolution"), n=25)
    fractions = [step.sensed_fraction for step in steps]
    assert all(later >= earlier for earlier, later in pairwise(fractions))
    points_m = episode.truth.anatomy.detection_points_m
    workspace = sphere_setup.workspace
    held = np.zeros(len(points_m), dtype=bool)
    for step in steps:
        position_m, normal = workspace.positions_m[step.pose_index], workspace.normals[step.pose_index]
        held |= sphere_setup.cone.contains(points_m, position_m, normal)
    # the free probe's frame passes through a quaternion, so a point on a mantle may flip
    assert fractions[-1] == pytest.approx(held.mean(), abs=1 / len(points_m))


def test_planners_face_one_truth_per_seed_and_seeds_differ(sphere_setup) -> None:
    centres = {}
    for name, seed in (("random", 3), ("multi-resolution", 3), ("random", 4)):
        truth = Episode(sphere_setup, make_planner(name), seed=seed, tumour_map=None).truth
        centres[name, seed] = truth.anatomy.detection_points_m
    assert np.array_equal(centres["random", 3], centres["multi-resolution", 3])
    assert not np.array_equal(centres["random", 3], centres["random", 4])


def test_the_arm_faces_the_truth_of_the_free_probe(sphere_setup, sphere_arm_setup) -> None:
    with_arm = Episode(sphere_arm_setup, make_planner("random"), seed=1, tumour_map=None)
    without = Episode(sphere_setup, make_planner("random"), seed=1, tumour_map=None)
    assert np.array_equal(with_arm.truth.anatomy.detection_points_m, without.truth.anatomy.detection_points_m)
    assert with_arm.truth.attainable_fraction >= 0.95


def test_an_episode_repeats_and_its_map_finds_what_was_sensed(sphere_setup) -> None:
    planner = make_planner("expected-improvement")
    first, steps = run(sphere_setup, planner, seed=1, n=12)
    second, again = run(sphere_setup, planner, seed=1, n=12)
    assert [step.pose_index for step in steps] == [step.pose_index for step in again]
    assert first.prediction.latent_mean.tobytes() == second.prediction.latent_mean.tobytes()
    assert max(step.reading.is_occupied.sum() for step in steps) > 0
    assert steps[-1].auprc > 0.5
    # Points well inside what was sensed as tumour are likely tumour, by the map.
    occupied_m = np.vstack([step.reading.points_m[step.reading.is_occupied] for step in steps])
    assert first.tumour_map.predict(occupied_m).probability.mean() > 0.8


def test_with_the_arm_the_reading_comes_from_where_the_tip_really_is(sphere_arm_setup) -> None:
    _, steps = run(sphere_arm_setup, make_planner("random"), n=4)
    workspace = sphere_arm_setup.workspace
    for step in steps:
        gap_m = np.linalg.norm(step.reading.T_world_probe[:3, 3] - workspace.positions_m[step.pose_index])
        assert gap_m == pytest.approx(step.ik.position_error_m, abs=1e-9)
        assert 0.0 < gap_m < 1e-3  # an arm never hits a pose exactly
        beam = step.reading.T_world_probe[:3, 2]
        angle_rad = np.arccos(np.clip(beam @ workspace.normals[step.pose_index], -1, 1))
        assert angle_rad == pytest.approx(step.ik.angle_error_rad, abs=1e-6)


def test_the_probe_lifts_between_places(sphere_arm_setup) -> None:
    _, steps = run(sphere_arm_setup, make_planner("random"), n=2)
    path_m = steps[1].motion.tips_m
    assert path_m.shape == (4, 3)  # contact, above it, above the next, contact
    assert path_m[1, 2] - path_m[0, 2] > 0.03  # up from the last place
    assert path_m[2, 2] - path_m[3, 2] > 0.03  # down to the next
    np.testing.assert_allclose(path_m[-1], steps[1].reading.T_world_probe[:3, 3], atol=1e-12)


class LamePositioner(Positioner):
    """Reaches only some poses of another positioner."""

    def __init__(self, positioner: Positioner, reachable: set[int]) -> None:
        self._positioner, self._reachable = positioner, reachable

    def reach(self, pose: int) -> IkResult:
        if pose in self._reachable:
            return self._positioner.reach(pose)
        return IkResult(IkStatus.TOO_FAR, np.empty(0), np.empty(0), 1.0, 0.0, 0, 0)

    def place(self, data, pose, *, is_lifted) -> None:
        self._positioner.place(data, pose, is_lifted=is_lifted)

    def shift(self, data, T_world_tip) -> str:
        return self._positioner.shift(data, T_world_tip)


def test_unreachable_poses_are_skipped_once_and_the_episode_ends_when_none_is_left(sphere_setup) -> None:
    class Listed(Planner):
        needs_belief = False

        def rank(self, situation):
            return iter(pose for pose in range(8) if situation.available(exclude_sensed=True)[pose])

    setup = replace(
        sphere_setup, positioner=LamePositioner(sphere_setup.positioner, set(range(14_400)) - {0, 1, 5})
    )
    told: list[int] = []
    episode = Episode(setup, Listed(), seed=0)
    steps = list(episode.steps(20, on_skipped=told.append))
    assert [step.pose_index for step in steps] == [2, 3, 4, 6, 7]
    assert told == [1, 2, 1]
    assert [skipped.pose_index for step in steps for skipped in step.skipped] == [0, 1, 5]
    assert "beyond the stretched arm" in episode.skipped[0].reason


def test_a_long_search_for_a_pose_within_reach_says_so_and_can_be_stopped(sphere_setup, tmp_path, capsys):
    config = config_of(planner="random", arm="none", steps=3)
    parts = make_parts(config)
    some = set(range(0, 14_400, 400))
    setup = replace(sphere_setup, positioner=LamePositioner(sphere_setup.positioner, some))
    output = Output(folder=tmp_path / "run", options=recorded(config))
    assert record_episode(parts, output, setup=setup)["n_skipped_poses"] > 100
    said = capsys.readouterr().err
    assert said.count("reaches none of the 100 poses chosen last") == 1
    assert "sounding reach" in said

    asked, before = [], signal.getsignal(signal.SIGINT)

    class Pressing(LamePositioner):
        def reach(self, pose):
            if signal.getsignal(signal.SIGINT) is not before:  # the episode runs
                asked.append(pose)
                signal.raise_signal(signal.SIGINT)
                return IkResult(IkStatus.TOO_FAR, np.empty(0), np.empty(0), 1.0, 0.0, 0, 0)
            return super().reach(pose)  # tumours are planted where it can sense

    setup = replace(sphere_setup, positioner=Pressing(sphere_setup.positioner, some))
    with pytest.raises(KeyboardInterrupt):
        record_episode(parts, replace(output, folder=tmp_path / "stopped"), setup=setup)
    assert len(asked) == 1
    assert '"interrupted"' in (tmp_path / "stopped" / "manifest.json").read_text()


def test_it_stops_when_enough_is_sensed(sphere_setup) -> None:
    episode = Episode(sphere_setup, make_planner("multi-resolution"), seed=0, tumour_map=None)
    steps = list(episode.steps(2000, until_sensed=0.5))
    assert steps[-1].sensed_fraction >= 0.5
    assert all(step.sensed_fraction < 0.5 for step in steps[:-1])
    assert steps[0].auprc is None


def test_a_planner_that_needs_the_map_cannot_go_without(sphere_setup) -> None:
    with pytest.raises(ValueError, match="tumour_map"):
        Episode(sphere_setup, make_planner("expected-improvement"), seed=0, tumour_map=None)


def test_before_anything_is_found_the_search_is_the_same_for_every_truth(sphere_setup) -> None:
    poses, n_blind = [], []
    for seed in (3, 4):
        episode = Episode(sphere_setup, make_planner("find-and-outline"), seed=seed)
        steps = list(episode.steps(4))
        poses.append([step.pose_index for step in steps])
        is_found = [bool(step.reading.is_occupied.any()) for step in steps]
        n_blind.append(is_found.index(True) if any(is_found) else len(steps) - 1)
    same = min(n_blind) + 1  # up to the choice made before the first of them found anything
    assert same >= 2
    assert poses[0][:same] == poses[1][:same]


def test_without_tumours_it_ends_by_itself_when_the_planner_is_confident(sphere_setup) -> None:
    setup = replace(sphere_setup, scenario=replace(sphere_setup.scenario, n_tumours=0))
    episode = Episode(setup, make_planner("find-and-outline"), seed=0)
    steps = list(episode.steps(30, until_confident=0.4))
    assert 1 < len(steps) < 30
    assert episode.confidence() >= 0.4


def test_it_ends_by_itself_when_what_is_left_is_not_worth_more_actions(sphere_setup) -> None:
    setup = replace(sphere_setup, scenario=replace(sphere_setup.scenario, n_tumours=0))
    lengths = []
    for miss_cost in (1.0, 5.0):
        episode = Episode(setup, make_planner("find-and-outline"), seed=0)
        steps = list(episode.steps(40, miss_cost=miss_cost))
        assert episode.ended_by == "not_worth"
        assert episode.situation().miss_cost == miss_cost
        lengths.append(len(steps))
    assert 0 < lengths[0] < lengths[1] < 40
    # A planner that does not weigh it goes on, and one that nobody tells the cost of a miss does too.
    assert len(list(Episode(setup, make_planner("random"), seed=0).steps(3, miss_cost=1e-6))) == 3
    assert (
        len(list(Episode(setup, make_planner("find-and-outline"), seed=0).steps(lengths[1] + 1))) > lengths[1]
    )


def test_planners_say_which_map_they_were_made_for() -> None:
    chosen = {
        name: make_parts(config_of(planner=name)).map_settings.prior_prevalence for name in planner_names()
    }
    calibrated = {name for name, prevalence in chosen.items() if prevalence == 0.02}
    assert calibrated == {
        "find-and-outline", "mutual-information", "expected-volume", "greedy-coverage", "trained",
        "find-and-outline-paths", "boustrophedon", "ergodic", "a-star",
    }  # fmt: skip
    assert {chosen[name] for name in set(chosen) - calibrated} == {0.5}
    config = config_of(planner="find-and-outline", map_settings="paper")
    assert make_parts(config).map_settings.prior_prevalence == 0.5
    with pytest.raises(UsageError, match="until_confident=1"):
        config_of(until_confident=1.0)
    with pytest.raises(UsageError, match="miss_cost=0.0: must be above 0"):
        config_of(miss_cost=0.0)

"""Looking ahead saves time and changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from planner import RandomOrder, WhatIsLeft, make_planner
from sim.campaign.lookahead import N_AHEAD, Lookahead
from sim.campaign.study import Trial
from sim.campaign.trial import run_trial
from sim.episode.episode import Episode
from sim.running.fields import config_of


@pytest.mark.parametrize("name", ["random", "multi-resolution"])
def test_an_episode_is_the_same_with_and_without(sphere_arm_setup, name) -> None:
    def steps(planner) -> list:
        episode = Episode(sphere_arm_setup, planner, seed=7, tumour_map=None, casts_rays=False)
        return [(step.pose_index, step.sensed_fraction, step.ik.q.tolist()) for step in episode.steps(12)]

    assert steps(Lookahead(make_planner(name), sphere_arm_setup.positioner)) == steps(make_planner(name))


def test_when_to_stop_is_asked_of_the_planner_itself(sphere_arm_setup) -> None:
    left = WhatIsLeft(
        n_found=1, expected_left=0.5, chance_of_none=0.6, unseeable_share=0.1, expected_unseeable=0.2
    )

    class Content(RandomOrder):
        def is_worth_going_on(self, situation) -> bool:
            return len(situation.sensed) * 10.0 < situation.miss_cost

        def what_is_left(self, situation) -> WhatIsLeft:
            return left

    planner = Lookahead(Content(), sphere_arm_setup.positioner)
    assert planner.weighs_cost
    assert not Lookahead(RandomOrder(), sphere_arm_setup.positioner).weighs_cost
    episode = Episode(sphere_arm_setup, planner, seed=7, tumour_map=None, casts_rays=False)
    assert len(list(episode.steps(9, miss_cost=25.0))) == 3
    assert planner.what_is_left(episode.situation()) is left


def test_the_poses_to_come_are_solved_together(sphere_arm_setup, monkeypatch) -> None:
    asked: list[int] = []
    prepare = sphere_arm_setup.positioner.prepare
    monkeypatch.setattr(
        sphere_arm_setup.positioner, "prepare", lambda poses: (asked.append(len(poses)), prepare(poses))
    )
    planner = Lookahead(make_planner("random"), sphere_arm_setup.positioner)
    episode = Episode(sphere_arm_setup, planner, seed=11, tumour_map=None, casts_rays=False)
    assert len(list(episode.steps(N_AHEAD))) == N_AHEAD
    assert asked == [N_AHEAD]


def test_poses_solved_together_are_answered_as_one_by_one(sphere_arm_setup) -> None:
    workspace = sphere_arm_setup.workspace
    kinematics = sphere_arm_setup.positioner._kinematics
    poses = np.random.default_rng(3).permutation(workspace.n_poses)[:12]
    together = kinematics.solve_many(workspace.positions_m[poses], workspace.normals[poses])
    for pose, answer in zip(poses, together, strict=True):
        alone = kinematics.solve(workspace.positions_m[pose], workspace.normals[pose])
        assert answer.status == alone.status
        assert np.array_equal(answer.q, alone.q)
        assert np.array_equal(answer.q_standoff, alone.q_standoff)
    assert kinematics.solve_many(np.empty((0, 3)), np.empty((0, 3))) == []


def test_an_episode_without_rays_senses_the_same_share(sphere_setup) -> None:
    shares = [
        [s.sensed_fraction for s in Episode(sphere_setup, make_planner("random"), seed=2, **how).steps(20)]
        for how in ({"tumour_map": None}, {"tumour_map": None, "casts_rays": False})
    ]
    assert shares[0] == shares[1]
    with pytest.raises(ValueError, match="casts_rays"):
        Episode(sphere_setup, make_planner("random"), seed=2, casts_rays=False)


def test_a_planner_that_looks_at_readings_has_them_in_a_campaign_without_a_map():
    def poses(kept):
        config = config_of(
            scenario="sphere", planner="trained", arm="none", motion="none", steps=8, seed=1001, map=kept
        )
        return run_trial(Trial(config)).poses

    assert poses("when-needed") == poses("always")

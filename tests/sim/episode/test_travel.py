"""Estimated times of travel, against the motion that a jump reports and for poses out of reach."""

from __future__ import annotations

import numpy as np
import pytest

from planner import make_planner
from sim.episode.episode import Episode
from sim.episode.moving.arm_motion import make_motion_model

POSES = np.array([7_000, 119, 14_000])


@pytest.mark.parametrize("kind", ["none", "kinematic"])
def test_the_estimate_is_what_a_jump_takes(sphere_arm_setup, kind) -> None:
    jump, data = make_motion_model(sphere_arm_setup, "none"), sphere_arm_setup.scene.new_data()
    estimate_s = make_motion_model(sphere_arm_setup, kind).travel.seconds(0, POSES)
    for pose, seconds in zip(POSES, estimate_s, strict=True):
        jump.move(data, 0)
        motion = jump.move(data, int(pose))
        above_s, there_s = motion.time_s[-3:-1]  # after the lift, and above the pose
        assert seconds == pytest.approx(there_s - above_s, rel=0.02)


def test_a_free_probe_goes_at_the_speed_of_its_tip(sphere_setup) -> None:
    places_m = sphere_setup.workspace.positions_m
    seconds = make_motion_model(sphere_setup).travel.seconds(0, POSES)
    way_m = np.linalg.norm(places_m[POSES] - places_m[0], axis=1)
    assert seconds == pytest.approx(way_m / 0.25)


def test_ways_that_count_become_shorter(sphere_setup) -> None:
    def transfers_m(**options):
        episode = Episode(sphere_setup, make_planner("find-and-outline", **options), seed=1003)
        sensed = [step.pose_index for step in episode.steps(12)]
        return np.linalg.norm(np.diff(sphere_setup.workspace.positions_m[sensed], axis=0), axis=1).sum()

    assert transfers_m(travel_weight=20.0) < 0.8 * transfers_m()

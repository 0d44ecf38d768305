"""Planners of paths: what each goes for, on flat ground with a planted belief."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from planner_situations import box_points, flat_workspace, make_situation
from scipy.sparse.csgraph import dijkstra

from planner import PlannerError, make_planner
from planner.find_and_outline.planner import FindAndOutline
from planner.paths.a_star import cheapest_path
from planner.paths.roadmap import Roadmap

WORKSPACE = flat_workspace(n_side=40)  # 4.6 mm apart
ROADMAP = Roadmap.of_surface(WORKSPACE)
POINTS = box_points()
NAMES = ("boustrophedon", "ergodic", "a-star", "find-and-outline-paths")


def on_ground(**more):
    return replace(make_situation(workspace=WORKSPACE, **more), roadmap=ROADMAP)


def play(planner, n_paths, situation):
    """The poses that are sensed when each path is gone and nothing is ever found."""
    sensed = list(situation.sensed)
    for _ in range(n_paths):
        path = next(planner.paths(replace(situation, sensed=tuple(sensed))))
        if sensed:
            sensed += ROADMAP.ways_from(sensed[-1]).to(path[0])[1::3]
        sensed += [pose for pose in path if pose != (sensed or [None])[-1]]
    return sensed


@pytest.mark.parametrize("name", NAMES)
def test_paths_end_at_poses_that_are_left(name) -> None:
    situation = on_ground(mean=np.full(len(POINTS), -4.0), sensed=(820,), skipped=set(range(0, 1600, 3)))
    paths = list(itertools.islice(make_planner(name).paths(situation), 6))
    assert len(paths) >= 3
    for path in paths:
        assert path[-1] not in situation.skipped
        assert all(type(pose) is int and 0 <= pose < WORKSPACE.n_poses for pose in path)


@pytest.mark.parametrize("name", ["ergodic", "a-star", "find-and-outline-paths"])
def test_no_pose_is_left_out_however_many_an_arm_cannot_reach(name) -> None:
    # An arm that reaches none of the best places has to hear of all the others.
    situation = on_ground(mean=np.full(len(POINTS), -4.0), sensed=(820,), skipped=set(range(0, 1600, 3)))
    ends = {path[-1] for path in make_planner(name).paths(situation)}
    assert ends == {*range(WORKSPACE.n_poses)} - situation.skipped - {820}


def test_a_planner_of_poses_has_paths_of_one_pose() -> None:
    situation = on_ground(mean=np.full(len(POINTS), -4.0), sensed=(3,))
    planner = FindAndOutline()
    ranked = list(itertools.islice(planner.rank(situation), 5))
    assert list(itertools.islice(planner.paths(situation), 5)) == [(pose,) for pose in ranked]


def test_the_boustrophedon_comes_near_every_pose_row_by_row() -> None:
    planner, situation = make_planner("boustrophedon"), on_ground()
    row_m = situation.cone.base_radius_m
    sensed = play(planner, 40, situation)
    away_m = np.linalg.norm(WORKSPACE.positions_m[:, None] - WORKSPACE.positions_m[sensed], axis=2).min(
        axis=1
    )
    # Half-way between two rows, and at a corner, half a row away in both directions.
    assert away_m.max() <= row_m / np.sqrt(2.0) + 0.005
    # It is no longer than its rows and the way from row to row, twice over for what a coarse grid adds.
    way_m = np.linalg.norm(np.diff(WORKSPACE.positions_m[sensed[: len(sensed) // 2]], axis=0), axis=1).sum()
    assert way_m < 2.0 * 0.18 * (0.18 / row_m + 1.0)


def test_the_ergodic_search_spends_its_readings_where_the_doubt_is() -> None:
    # Two thirds of the doubt lie on the right, one third on the left.
    mean = np.where(POINTS[:, 0] > 0.0, -1.0, -2.2)
    situation = on_ground(mean=mean, variance=np.full(len(POINTS), 1e-6))
    sensed = play(make_planner("ergodic"), 30, situation)
    right = np.mean(WORKSPACE.positions_m[sensed][:, 0] > 0.0)
    assert 0.5 < right < 0.85


def test_a_star_finds_the_cheapest_path_of_dijkstra() -> None:
    rng = np.random.default_rng(4)
    dearness = rng.uniform(0.0, 5.0, WORKSPACE.n_poses)
    costs = ROADMAP.graph.copy()
    costs.data = costs.data * (1.0 + dearness[costs.indices])
    for start, goal in rng.integers(0, WORKSPACE.n_poses, (5, 2)).tolist():
        path = cheapest_path(ROADMAP, start, goal, dearness)
        cost = sum(costs[a, b] for a, b in itertools.pairwise(path))
        assert (path[0], path[-1]) == (start, goal)
        assert cost == pytest.approx(dijkstra(costs, indices=start)[goal])


def test_find_and_outline_prefers_what_it_sees_in_a_second_to_what_it_sees() -> None:
    situation = on_ground(mean=np.full(len(POINTS), -4.0), sensed=(0,))
    planner = make_planner("find-and-outline-paths")
    near = next(planner.paths(situation))[-1]
    far = next(planner.paths(replace(situation, sweep_speed_m_s=1e3)))[-1]
    length_m = ROADMAP.ways_from(0).lengths_m
    assert length_m[near] < length_m[far] or near == far
    # A slow probe with a cost beside the way goes farther for it.
    patient = make_planner("find-and-outline-paths", overhead_s=30.0)
    assert length_m[next(patient.paths(situation))[-1]] > length_m[near]


@pytest.mark.parametrize(
    ("name", "option"),
    [
        ("boustrophedon", {"row_share": 0.0}),
        ("ergodic", {"reach_m": -1.0}),
        ("a-star", {"explore": 1.5}),
        ("find-and-outline-paths", {"overhead_s": -1.0}),
    ],
)
def test_options_out_of_range_are_refused(name, option) -> None:
    with pytest.raises(PlannerError, match=next(iter(option))):
        make_planner(name, **option)

"""Ways between poses: what their seconds decide, and batches in the order of the shortest tour."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planner_situations import flat_workspace
from searched import FEW, play, situation

from planner import FindAndOutline
from planner.find_and_outline.tour import shortest_tour


def test_a_weight_on_travel_shortens_the_way():
    workspace = flat_workspace()

    def way_m(**options):
        sensed, _ = play(FindAndOutline(balls=FEW, **options), 15, workspace)
        return np.linalg.norm(np.diff(workspace.positions_m[sensed], axis=0), axis=1).sum()

    fewest = way_m()
    assert way_m(travel_weight=3.0) < 0.7 * fewest
    assert way_m(batch=6) < 0.8 * fewest


def test_seconds_of_motion_decide_between_poses_of_one_worth():
    workspace = flat_workspace()
    slow_side = workspace.positions_m[:, 0] > workspace.positions_m[:, 0].mean()

    def motion_s(poses):
        return np.where(slow_side[poses], 60.0, 1.0)

    asked = situation(workspace=workspace, sensed=(90,))
    asked = replace(asked, motion_s=motion_s)
    planner = FindAndOutline(balls=FEW, travel_weight=1.0)
    assert not slow_side[list(itertools.islice(planner.rank(asked), 5))].any()
    # What cannot be reached is not among those whose way counts; it comes last or not at all.
    blocked = replace(asked, motion_s=lambda poses: np.where(slow_side[poses], np.inf, 1.0))
    first = list(
        itertools.islice(
            planner.rank(blocked), len(workspace.best_apart(planner.score(blocked), 0.02)) // 2 - 1
        )
    )
    assert not slow_side[first].any()


@pytest.mark.parametrize("has_failures", [False, True])
def test_a_batch_is_the_greedy_choice_in_the_order_of_the_shortest_way(has_failures):
    workspace = flat_workspace(30)  # 6 mm apart
    beside = np.flatnonzero(workspace.positions_m[:, 0] > 0.0)
    skipped = frozenset(beside[::2].tolist() if has_failures else ())
    asked = situation(workspace=workspace, sensed=(90,), skipped=skipped)
    greedy, sensed = [], [90]
    for _ in range(4):
        so_far = situation(workspace=workspace, sensed=tuple(sensed), skipped=skipped)
        greedy.append(next(iter(FindAndOutline(balls=FEW).rank(so_far))))
        sensed.append(greedy[-1])
    batch = list(itertools.islice(FindAndOutline(balls=FEW, batch=4).rank(asked), 4))
    assert sorted(batch) == sorted(greedy)
    assert has_failures != any(pose in beside for pose in batch)

    def way_m(order):
        return np.linalg.norm(np.diff(workspace.positions_m[[90, *order]], axis=0), axis=1).sum()

    assert way_m(batch) == pytest.approx(min(map(way_m, itertools.permutations(greedy))))


@given(st.integers(1, 6), st.integers(0, 10_000))
def test_a_tour_is_the_best_of_all_orders(k, seed):
    rng = np.random.default_rng(seed)
    first, between = rng.random(k), rng.random((k, k))

    def cost(order):
        return first[order[0]] + sum(between[i, j] for i, j in itertools.pairwise(order))

    tour = shortest_tour(first, between)
    assert sorted(tour) == list(range(k))
    assert cost(tour) == pytest.approx(min(cost(order) for order in itertools.permutations(range(k))))


def test_a_batch_larger_than_what_is_left_proposes_no_pose_twice_and_none_that_is_gone():
    workspace = flat_workspace()
    sensed = tuple(range(workspace.n_poses - 3))
    ranked = list(FindAndOutline(balls=FEW, batch=6).rank(situation(workspace=workspace, sensed=sensed)))
    assert sorted(ranked) == list(range(workspace.n_poses - 3, workspace.n_poses))

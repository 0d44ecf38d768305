"""What each planner chooses: planted truths, counts, uniformity, and the laws every ranking obeys."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from planner_situations import box_points, flat_workspace, make_situation
from scipy.stats import chisquare

from planner import (
    Cone,
    ExpectedImprovement,
    MultiResolution,
    PlannerError,
    RandomOrder,
    Workspace,
    make_planner,
    planner_names,
    visible_points,
)

POINTS = box_points()
BLOB_M = np.array([0.053, -0.04, -0.06])
BLOB = int(np.argmin(np.linalg.norm(POINTS - BLOB_M, axis=1)))


def blob_mean(height=2.0):
    return height * np.exp(-np.sum((POINTS - POINTS[BLOB]) ** 2, axis=1) / 0.02**2)


def top(planner, situation, n=1):
    return list(itertools.islice(planner.rank(situation), n))


# --- laws of every ranking ---


@pytest.mark.parametrize("name", planner_names())
@pytest.mark.parametrize("sensed", [(), (3, 17, 250)])
def test_a_ranking_lists_every_pose_left_once_and_no_skipped_one(name, sensed):
    situation = make_situation(mean=blob_mean(), sensed=sensed, skipped={5, 100, 399})
    ranking = list(make_planner(name).rank(situation))
    assert len(ranking) == len(set(ranking))
    repeats = set() if name == "multi-resolution" else set(sensed)
    assert set(ranking) == set(range(400)) - {5, 100, 399} - repeats
    assert all(type(pose) is int for pose in ranking)


@pytest.mark.parametrize("name", planner_names())
@pytest.mark.parametrize("sensed", [(), (3,)])
def test_the_same_generator_gives_the_same_ranking(name, sensed):
    first, second = (
        list(make_planner(name).rank(make_situation(mean=blob_mean(), sensed=sensed, seed=4)))
        for _ in range(2)
    )
    assert first == second


@pytest.mark.parametrize("name", planner_names())
def test_a_ranking_is_empty_when_the_arm_reaches_nothing(name):
    situation = make_situation(mean=blob_mean(), sensed=(3,), skipped=range(400))
    assert list(make_planner(name).rank(situation)) == []


# --- expected improvement ---


def test_the_first_pose_is_random():
    situations = [make_situation(mean=blob_mean(), seed=seed) for seed in range(20)]
    assert len({top(ExpectedImprovement(), situation)[0] for situation in situations}) > 10


def test_a_planted_blob_of_variance_and_of_mean_is_chosen():
    distances = np.sum((POINTS - POINTS[BLOB]) ** 2, axis=1)
    uncertain = make_situation(
        mean=np.zeros(len(POINTS)), variance=0.1 + np.exp(-distances / 0.02**2), sensed=(0,)
    )
    likely = make_situation(mean=blob_mean(), variance=np.full(len(POINTS), 0.5), sensed=(0,))
    workspace = uncertain.workspace
    above = int(np.argmin(np.linalg.norm(workspace.positions_m[:, :2] - POINTS[BLOB, :2], axis=1)))
    assert top(ExpectedImprovement(), uncertain) == [above]
    assert top(ExpectedImprovement(), likely) == [above]


def test_what_was_sensed_well_loses_to_what_was_not():
    # A tumour that is known (high mean, no variance) against a place nobody has looked at.
    mean = np.zeros(len(POINTS))
    mean[BLOB] = 6.0
    variance = np.full(len(POINTS), 1e-6)
    unknown = int(np.argmin(np.linalg.norm(POINTS + BLOB_M * [1, 1, -1], axis=1)))
    variance[unknown] = 4.0
    situation = make_situation(mean=mean, variance=variance, sensed=(0,))
    assert int(np.argmax(ExpectedImprovement().score(situation.prediction))) == unknown


def test_the_alternatives_see_the_query_point_too_in_order_of_alignment():
    situation = make_situation(mean=blob_mean(), sensed=(0,))
    workspace, cone = situation.workspace, situation.cone
    sees = cone.contains(POINTS[BLOB], workspace.positions_m, workspace.normals)
    ranking = top(ExpectedImprovement(), situation, int(sees.sum()))
    assert sees.sum() > 3
    assert sees[ranking].all()
    assert (np.diff(workspace.angles_to_rad(POINTS[BLOB])[ranking]) >= 0).all()


@pytest.mark.parametrize("is_known", [False, True])
def test_a_query_point_out_of_every_cones_sight_gives_way_to_the_next(is_known):
    points = np.array(
        [[0.04, 0.04, -0.5], [-0.06, 0.02, -0.05]]
    )  # the first lies five times the cone's depth down
    situation = make_situation(points=points, mean=np.array([3.0, 0.0]), sensed=(0,))
    if is_known:
        is_visible = visible_points(situation.workspace, situation.cone, points)
        assert is_visible.tolist() == [False, True]
        situation = replace(situation, is_visible=is_visible)
    ranking = top(ExpectedImprovement(), situation)
    assert ranking == [int(np.argmin(situation.workspace.angles_to_rad(points[1])))]


def test_a_sensed_poses_neighbours_come_last():
    best = top(ExpectedImprovement(exclusion_share=0.0), make_situation(mean=blob_mean(), sensed=(0,)))[0]
    again = make_situation(mean=blob_mean(), sensed=(0, best))
    share = 0.02 / again.cone.base_radius_m
    ranking = list(ExpectedImprovement(exclusion_share=share).rank(again))
    positions = again.workspace.positions_m
    distances = np.linalg.norm(positions[ranking][:, None] - positions[[0, best]], axis=-1).min(axis=1)
    n_near = int((distances < 0.02).sum())
    assert n_near > 5
    assert (distances[:-n_near] >= 0.02).all()
    # Without a radius the very next pose is a neighbour, one pitch of 9.5 mm away.
    without_radius = top(ExpectedImprovement(exclusion_share=0.0), again)[0]
    assert without_radius in again.workspace.neighbours(8)[best]


def test_first_within_threshold_takes_the_lowest_index_not_the_best_aligned():
    planner = ExpectedImprovement(pose_rule="first-within-threshold")
    situation = make_situation(mean=blob_mean(), sensed=(0,), workspace=flat_workspace(n_side=60))
    angles = situation.workspace.angles_to_rad(POINTS[BLOB])
    within = np.flatnonzero(angles <= math.radians(5.0))
    assert len(within) > 1
    assert top(planner, situation, len(within)) == within.tolist()
    assert top(planner, situation) != top(ExpectedImprovement(), situation)


def test_used_poses_come_back_only_when_they_are_not_excluded():
    fresh = make_situation(mean=blob_mean(), sensed=(0,))
    best = top(ExpectedImprovement(), fresh)[0]
    again = make_situation(mean=blob_mean(), sensed=(0, best))
    assert best not in list(ExpectedImprovement().rank(again))
    assert top(ExpectedImprovement(exclude_sensed=False), again) == [best]


def test_latent_and_probability_read_one_belief_differently():
    # A sure tumour; a place that is surely free, its latent wide; one that is likely and rather well known.
    mean, variance = np.full(len(POINTS), -60.0), np.full(len(POINTS), 1e-6)
    wide, likely = 10, 20
    mean[[BLOB, wide, likely]] = [5.8, -30.0, 2.0]
    variance[[BLOB, wide, likely]] = [1e-6, 100.0, 1.0]
    prediction = make_situation(mean=mean, variance=variance, sensed=(0,)).prediction
    # With h = phi + z Phi: latent 10 h(-3.6) against h(-3.8); probability 0.03 h(-30) against 0.1 h(-1.3).
    latent, probability = (
        ExpectedImprovement(values=values).score(prediction) for values in ("latent", "probability")
    )
    assert latent[wide] > latent[likely]
    assert probability[likely] > probability[wide]


def test_it_needs_a_belief_once_there_is_a_reading():
    with pytest.raises(PlannerError, match="needs the map's prediction"):
        ExpectedImprovement().rank(make_situation(sensed=(0,)))


def test_options_out_of_range_are_refused():
    with pytest.raises(PlannerError, match="one of latent, probability; got 'odds'"):
        ExpectedImprovement(values="odds")
    with pytest.raises(PlannerError, match="threshold_rad"):
        ExpectedImprovement(threshold_rad=0.0)
    with pytest.raises(PlannerError, match="xi"):
        ExpectedImprovement(xi=-0.1)


# --- random ---


def test_random_draws_every_pose_equally_often():
    workspace = flat_workspace(n_side=4)
    rng = np.random.default_rng(11)
    firsts = []
    for _ in range(3_200):
        situation = replace(make_situation(workspace=workspace, skipped={0}), rng=rng)
        firsts.append(top(RandomOrder(), situation)[0])
    counts = np.bincount(firsts, minlength=16)
    assert counts[0] == 0
    # Chi-square over 15 poses; a fair draw fails this once in a thousand seeds, and the seed is fixed.
    assert chisquare(counts[1:]).pvalue > 1e-3


# --- multi-resolution ---


def play(workspace, n_steps, unreachable=frozenset()):
    """Poses that an episode would sense, one at a time, its arm never reaching some."""
    sensed, skipped = [], set()
    for _ in range(n_steps):
        situation = make_situation(workspace=workspace, sensed=sensed, skipped=skipped)
        for pose in MultiResolution().rank(situation):
            if pose not in unreachable:
                sensed.append(pose)
                break
            skipped.add(pose)
    return sensed


def test_rounds_of_1_4_16_64_sense_the_centres_of_their_cells_in_raster_order():
    workspace = flat_workspace(
        n_side=33, width_m=0.16
    )  # 5 mm apart: centres of up to 16 x 16 cells are poses
    expected = []
    for n_side in (1, 2, 4, 8):
        centres = (np.arange(n_side) + 0.5) / n_side * 0.16 - 0.08
        expected += [(x, y) for y in centres for x in centres]
    sensed = play(workspace, 1 + 4 + 16 + 64)
    # The poses lie on the centres but for the rounding of the grid's coordinates.
    np.testing.assert_allclose(workspace.positions_m[sensed, :2], expected, atol=1e-12)
    assert len(set(sensed)) == 85


def test_rounds_finer_than_the_poses_repeat_them_but_never_twice_in_a_row_nor_in_a_round():
    workspace = flat_workspace(n_side=5)
    sensed = play(workspace, 300)
    assert all(first != second for first, second in itertools.pairwise(sensed))
    # From 8 x 8 cells on every pose has a cell of its own, so each round is the 25 poses in raster order.
    rows_first = np.arange(25).reshape(5, 5).T.ravel().tolist()
    assert sensed[21 : 21 + 25] == rows_first
    assert sensed[46 : 46 + 25] == rows_first


def test_cells_without_poses_are_passed():
    flat = flat_workspace(n_side=16)
    is_kept = ~(
        (flat.positions_m[:, 0] > 0) & (flat.positions_m[:, 1] > 0)
    )  # an L: no organ in the last quarter
    workspace = Workspace(flat.positions_m[is_kept], flat.normals[is_kept])
    sensed = play(workspace, 1 + 3 + 12)
    quarters = np.sign(workspace.positions_m[sensed[1:4], :2])
    np.testing.assert_array_equal(quarters, [[-1, -1], [1, -1], [-1, 1]])
    assert len(set(sensed)) == 16


def test_an_unreachable_centre_gives_way_to_its_cells_next_pose_and_the_rounds_go_on():
    workspace = flat_workspace(n_side=33, width_m=0.16)
    plain = play(workspace, 21)
    blocked = play(workspace, 21, unreachable={plain[2]})
    assert blocked[:2] == plain[:2]
    # The poses lie on a 5 mm grid, so the next best is one pitch from the centre.
    distance = np.linalg.norm(workspace.positions_m[blocked[2]] - workspace.positions_m[plain[2]])
    assert distance == pytest.approx(0.005, abs=1e-9)
    assert blocked[3:] == plain[3:]


def test_a_cell_out_of_reach_is_passed_once_and_for_all():
    workspace = flat_workspace(n_side=33, width_m=0.16)
    quarter = set(np.flatnonzero((workspace.positions_m[:, :2] < -1e-9).all(axis=1)).tolist())
    sensed = play(workspace, 1 + 3 + 12, unreachable=quarter)
    plain = play(workspace, 21)
    assert sensed == [pose for pose in plain if pose not in quarter]


def test_one_single_pose_is_all_there_is():
    workspace = Workspace(np.zeros((1, 3)), np.array([[0.0, 0.0, -1.0]]))
    assert play(workspace, 3) == [0, 0, 0]


# --- registry ---


def test_an_unknown_name_or_option_lists_what_exists():
    with pytest.raises(
        PlannerError, match="expected-improvement, find-and-outline, random, multi-resolution"
    ):
        make_planner("greedy")
    with pytest.raises(PlannerError, match="it has values, pose_rule"):
        make_planner("expected-improvement", threshold_deg=5)


def test_options_reach_the_planner():
    planner = make_planner("expected-improvement", xi=0.5, values="probability")
    assert planner == ExpectedImprovement(xi=0.5, values="probability")
    without = {name for name in planner_names() if not make_planner(name).needs_belief}
    assert without == {"random", "multi-resolution", "greedy-coverage", "trained", "boustrophedon"}


def test_a_shallower_cone_leads_to_another_choice():
    situation = make_situation(mean=blob_mean(), sensed=(0,))
    with_deep_cone = top(ExpectedImprovement(), situation)
    shallow = replace(situation, cone=Cone(math.radians(11.5), 0.02))  # the blob lies at 60 mm
    assert top(ExpectedImprovement(), shallow) != with_deep_cone

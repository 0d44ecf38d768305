"""Find, then outline: planted tumours, hidden balls and their set system, stopping, and laws of the ranking."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from planner_situations import flat_workspace, make_situation
from scipy.spatial import cKDTree
from scipy.stats import nbinom
from searched import CONE, FEW, PLANNER, POINTS, blob, play, seen_free, situation

from mapping import LabelledPoints
from planner import FindAndOutline, PlannerError, Workspace
from planner.find_and_outline.fine_lattice import fine_lattice
from planner.find_and_outline.frontier import seen_weight
from planner.find_and_outline.hidden_balls import distance_to_cones, hidden_balls
from planner.find_and_outline.still_hiding import still_hiding
from planner.find_and_outline.tour import shortest_tour

# --- search ---


def test_the_distance_to_a_cone_is_that_of_its_densely_sampled_faces():
    workspace = Workspace(np.zeros((1, 3)), np.array([[0.0, 0.0, -1.0]]))
    points = np.random.default_rng(0).uniform([-0.03, -0.03, -0.1], [0.03, 0.03, -0.02], (200, 3))
    turn, depth = np.meshgrid(np.linspace(0, 2 * np.pi, 400), np.linspace(0, CONE.depth_m, 400))
    radius = depth * math.tan(CONE.half_angle_rad)
    faces = np.stack([radius * np.cos(turn), radius * np.sin(turn), -depth], axis=-1).reshape(-1, 3)
    expected, _ = cKDTree(faces).query(points)
    expected[CONE.contains(points, np.zeros(3), np.array([0.0, 0.0, -1.0]))] *= -1.0
    found = distance_to_cones(workspace, CONE, points)[:, 0]
    near = np.abs(points[:, 2] + CONE.depth_m) > 0.03  # away from the base, the mantle is what is near
    np.testing.assert_allclose(found[near], expected[near], atol=3e-4)  # the samples lie 0.3 mm apart


def test_balls_fit_into_the_organ_and_the_poses_that_find_them_reach_into_them():
    workspace, distance_m = flat_workspace(), np.full(len(POINTS), 0.011)
    balls = hidden_balls(workspace, CONE, POINTS, distance_m, FEW)
    assert 0.005 <= balls.radii_m.min() < 0.006 < 0.010 < balls.radii_m.max() <= 0.011
    assert balls.weights.sum() == pytest.approx(1.0, abs=1e-5)  # float32
    # By another way: a ball is found if some point of a sphere of half its radius lies in the cone.
    directions = np.random.default_rng(1).normal(size=(400, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    table, n_asked, n_equal = balls.finds.toarray() > 0, 0, 0
    for pose, ball in itertools.product((0, 137, 210), range(0, len(balls.radii_m), 5)):
        shell = np.vstack(
            [balls.centres_m[ball], balls.centres_m[ball] + 0.5 * balls.radii_m[ball] * directions]
        )
        seen = CONE.contains(shell, workspace.positions_m[pose], workspace.normals[pose]).any()
        n_asked, n_equal = n_asked + 1, n_equal + (seen == table[pose, ball])
    assert n_equal / n_asked > 0.98  # 400 directions miss a graze


def test_the_search_is_greedy_and_every_gain_is_at_most_the_one_before():
    workspace = flat_workspace()
    planner = FindAndOutline(balls=FEW, fading=0.0)
    balls = hidden_balls(workspace, CONE, POINTS, None, FEW)
    table, left, sensed = balls.finds.toarray(), balls.weights.astype(float), []
    gains = []
    for _ in range(12):
        asked = replace(situation(workspace=workspace, sensed=sensed), search_points_m=POINTS)
        score = planner.search_score(asked)
        np.testing.assert_allclose(score, table @ left, atol=1e-6)  # float32
        sensed.append(next(iter(planner.rank(asked))))
        gains.append(score[sensed[-1]])
        left = left * (table[sensed[-1]] == 0)
    assert all(later <= earlier + 1e-6 for earlier, later in itertools.pairwise(gains))
    assert gains[0] > 1.3 * gains[-1]


def test_the_search_covers_far_more_than_random_poses_do():
    workspace = flat_workspace()
    sensed, _ = play(PLANNER, 40, workspace)
    assert len(set(sensed)) == 40
    balls = hidden_balls(workspace, CONE, POINTS, None, FEW)
    covered = (balls.times_found(tuple(sensed)) > 0).mean()
    random = [
        (balls.times_found(tuple(np.random.default_rng(seed).permutation(400)[:40])) > 0).mean()
        for seed in range(5)
    ]
    assert covered > max(random) + 0.1


def test_the_more_was_found_the_more_is_a_search_worth():
    none, some = situation(sensed=(0,)), situation(mean=blob(np.array([0.0, 0.0, -0.06]), 0.02), sensed=(0,))
    search = PLANNER.search_score(none)
    np.testing.assert_allclose(PLANNER.score(none), PLANNER.hidden_m3 * search, rtol=1e-9)
    outlined_m3 = PLANNER.outline_score(some)
    outlined_m3[outlined_m3 < PLANNER.least_gain_m3] = 0.0
    found_m3 = np.mean(some.prediction.probability > 0.5) * np.prod(
        np.ptp(POINTS, axis=0)
    )  # of the box's volume
    expected_m3 = (PLANNER.hidden_m3 + found_m3) * search
    gained_m3 = PLANNER.score(some) - outlined_m3
    assert gained_m3.sum() == pytest.approx(
        expected_m3.sum(), rel=0.35
    )  # cells at the box's faces stand out of it


# --- outline ---


def test_a_likely_tumour_that_no_cone_held_is_covered_next():
    centre_m = np.array([0.04, -0.03, -0.06])
    asked = situation(mean=blob(centre_m, 0.02), sensed=(0,))
    pose = next(iter(PLANNER.rank(asked)))
    lateral_m = np.linalg.norm(asked.workspace.positions_m[pose, :2] - centre_m[:2])
    assert lateral_m < 0.01  # one pitch: the pose above it


def test_outlining_ends_when_all_of_it_and_its_margin_were_sensed():
    mean, sensed = blob(np.array([0.0, 0.0, -0.06]), 0.02), [0]
    planner = replace(PLANNER, hidden_m3=1e-9, hidden_ratio=0.0)  # nothing else may be expected
    for _ in range(25):
        asked = situation(mean=mean, sensed=sensed)
        if planner.outline_score(asked).max() < planner.least_gain_m3:
            break
        sensed.append(next(iter(planner.rank(asked))))
    assert 2 < len(sensed) < 20
    held = np.zeros(len(POINTS), dtype=bool)
    for pose in sensed:
        held |= CONE.contains(POINTS, asked.workspace.positions_m[pose], asked.workspace.normals[pose])
    assert held[mean > 0].all()


def test_two_labels_of_tumour_that_the_map_smooths_away_are_followed():
    graze_m = np.array([[0.05, 0.05, -0.07], [0.051, 0.05, -0.071]])
    free_m = np.random.default_rng(0).uniform([-0.02, -0.02, -0.08], [0.0, 0.0, -0.02], (500, 3))
    reading = LabelledPoints(np.vstack([graze_m, free_m]), np.arange(502) < 2)
    pose = next(iter(PLANNER.rank(situation(sensed=(0,), readings=[reading]))))
    assert np.linalg.norm(flat_workspace().positions_m[pose, :2] - 0.05) < 0.02


def test_scattered_false_labels_are_not_believed_and_a_planted_tumour_is():
    rng = np.random.default_rng(3)
    points_m = rng.uniform(0.0, 0.05, (1000, 3))
    is_tumour = np.linalg.norm(points_m - 0.02, axis=1) < 0.012
    called = is_tumour ^ (rng.random(1000) < 0.05)
    reading = LabelledPoints(points_m, called)
    assert len(reading.believed_tumour_m(0.0)) == called.sum()
    believed_m = reading.believed_tumour_m(0.05)
    gap_m = np.linalg.norm(believed_m - 0.02, axis=1)
    assert (gap_m < 0.012).sum() > 0.8 * (called & is_tumour).sum()
    assert (gap_m > 0.016).sum() <= 2  # of about 45 false labels; 0.2 expected by chance


def test_the_seen_weight_is_what_each_cone_holds():
    workspace = flat_workspace(n_side=9)
    points_m = np.random.default_rng(2).uniform([-0.08, -0.08, -0.1], [0.08, 0.08, 0.0], (300, 3))
    weights = np.random.default_rng(3).random(300)
    expected = [
        weights[CONE.contains(points_m, position, normal)].sum()
        for position, normal in zip(workspace.positions_m, workspace.normals, strict=True)
    ]
    np.testing.assert_allclose(seen_weight(workspace, CONE, points_m, weights), expected, rtol=1e-12)


def test_the_fine_lattice_keeps_the_search_points_and_interpolates_linear_fields_exactly():
    lattice = fine_lattice(POINTS)
    field = POINTS @ [1.0, -2.0, 3.0]
    np.testing.assert_allclose(
        lattice.interpolate(field), lattice.points_m @ [1.0, -2.0, 3.0], atol=1e-8
    )  # axes are told apart at 1 nm
    fine = {tuple(row) for row in np.round(lattice.points_m, 6)}
    assert {tuple(row) for row in np.round(POINTS, 6)} <= fine
    assert lattice.cell_m3 * len(lattice.points_m) == pytest.approx(
        0.16 * 0.16 * 0.07, rel=0.3
    )  # half cells at rims


# --- the ranking ---


def test_no_pose_is_asked_for_again_and_the_neighbours_of_failures_come_later():
    workspace = flat_workspace(n_side=40)  # 4.6 mm apart: eight neighbours within the radius of a failure
    first = next(iter(PLANNER.rank(situation(workspace=workspace))))
    ranking = list(itertools.islice(PLANNER.rank(situation(workspace=workspace)), 4))
    assert ranking[0] == first
    near = set(workspace.within(first, 0.0081))
    assert len(near) == 9
    assert not near & set(ranking[1:])
    blocked = set(range(0, workspace.n_poses, 3)) | near
    sensed, skipped = play(PLANNER, 10, workspace, unreachable=blocked)
    assert not set(sensed) & blocked
    assert skipped <= blocked


def test_it_chooses_the_same_whatever_the_generator():
    choices = {tuple(itertools.islice(PLANNER.rank(situation(seed=seed)), 3)) for seed in range(5)}
    assert len(choices) == 1


# --- stopping ---


def test_the_confidence_is_the_negative_binomials_chance_of_no_more():
    # k found at coverage C: hidden ~ NegBin(k + 1, C), whose mass at 0 is C^(k + 1).
    for k, share in ((0, 0.7), (3, 0.95)):
        assert nbinom.pmf(0, k + 1, share) == pytest.approx(share ** (k + 1), rel=1e-12)
    workspace, sensed = flat_workspace(), (90, 210, 305)
    readings = seen_free(workspace, sensed)
    asked = situation(workspace=workspace, sensed=sensed, readings=readings)
    assert PLANNER.confidence(situation(workspace=workspace)) == 0.0
    # By another way: balls of 5 mm drawn at random, looked at if any point lies inside.
    rng = np.random.default_rng(1)
    centres_m = rng.uniform([-0.08, -0.08, -0.08], [0.08, 0.08, -0.01], (1500, 3))
    points_m = np.concatenate([reading.points_m for reading in readings])
    gap_m = np.min(np.linalg.norm(centres_m[:, None] - points_m, axis=2), axis=1)
    assert PLANNER.confidence(asked) == pytest.approx(np.mean(gap_m < 0.0056), abs=0.03)


def test_a_ball_hides_where_no_point_was_called_free_or_tumour_inside_it():
    workspace = flat_workspace()
    balls = hidden_balls(workspace, CONE, POINTS, None, FEW)
    assert still_hiding(balls, (), 0.0) == pytest.approx(balls.weights)
    ball = int(np.argmax(balls.radii_m))
    inside_m = balls.centres_m[ball] + balls.radii_m[ball] * np.array([[0.5, 0, 0], [0, 0.9, 0], [0, 0, 1.1]])
    free = (LabelledPoints(inside_m, np.zeros(3, dtype=bool)),)
    assert still_hiding(balls, free, 0.0)[ball] == 0.0
    assert still_hiding(balls, free, 0.3)[ball] == pytest.approx(balls.weights[ball] * 0.3**2)
    found = (LabelledPoints(inside_m, np.array([True, False, False])),)
    assert still_hiding(balls, found, 0.3)[ball] == 0.0
    many = free * 70  # more than are asked together
    assert still_hiding(balls, many, 0.9)[ball] == pytest.approx(balls.weights[ball] * 0.9**140)


def test_a_label_that_chance_explains_does_not_show_that_a_ball_was_found():
    balls = hidden_balls(flat_workspace(), CONE, POINTS, None, FEW)
    ball = int(np.argmax(balls.radii_m))
    free_m = balls.centres_m[ball] + balls.radii_m[ball] * np.array([[2.0, 0, 0]]) + np.zeros((200, 3))
    points_m = np.vstack([balls.centres_m[ball], free_m])
    reading = (LabelledPoints(points_m, np.arange(201) == 0),)
    assert still_hiding(balls, reading, 0.0, 0.0)[ball] == 0.0
    assert still_hiding(balls, reading, 0.0, 0.05)[ball] == pytest.approx(balls.weights[ball])


def test_without_a_tumour_it_becomes_sure_and_with_an_open_one_it_is_not():
    workspace = flat_workspace()
    planner = replace(PLANNER, sure_radius_m=0.012)
    sensed, _ = play(planner, 50, workspace)
    readings = seen_free(workspace, sensed)
    confidences = [
        planner.confidence(situation(workspace=workspace, sensed=sensed[:n], readings=readings[:n]))
        for n in (1, 5, 10, 20, 50)
    ]
    assert all(later >= earlier for earlier, later in itertools.pairwise(confidences))
    assert confidences[-1] > 0.95
    open_one = situation(workspace=workspace, mean=blob(np.array([0.07, 0.07, -0.03]), 0.02), sensed=(0,))
    assert PLANNER.confidence(open_one) == 0.0


# --- arguments ---


def test_options_out_of_range_and_a_missing_belief_are_refused():
    with pytest.raises(PlannerError, match="`margin_m` must be above 0"):
        FindAndOutline(margin_m=0.0)
    with pytest.raises(PlannerError, match="fading"):
        FindAndOutline(fading=1.0)
    with pytest.raises(PlannerError, match="travel_weight"):
        FindAndOutline(travel_weight=-1.0)
    with pytest.raises(PlannerError, match="`batch` must be 1 to 12"):
        FindAndOutline(batch=13)
    with pytest.raises(ValueError, match="a tour has 1 to 12 stops"):
        shortest_tour([], [])
    with pytest.raises(PlannerError, match="needs the map's prediction"):
        list(PLANNER.rank(make_situation(sensed=(0,))))

"""find-and-outline where views may be wrong: what was looked at once may still hide, and findings are confirmed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logit

from mapping import LabelledPoints
from planner import FindAndOutline
from planner.find_and_outline.frontier import unconfirmed_points
from planner.find_and_outline.hidden_balls import BallPrior, HiddenBalls, hidden_balls
from planner.find_and_outline.still_hiding import still_hiding
from tests.helpers.planner_situations import box_points, flat_workspace, make_situation

PLACE_M = np.array([0.0, 0.0, -0.05])


def situation_with(probability_at_place: float, sensed: tuple[int, ...], missed_rate: float):
    """A belief in nothing but a ball of 12 mm about one place."""
    points = box_points()
    is_near = np.linalg.norm(points - PLACE_M, axis=1) < 0.015
    mean = np.where(is_near, logit(probability_at_place), logit(0.001))
    situation = make_situation(points=points, mean=mean, variance=np.zeros(len(points)), sensed=sensed)
    return replace(situation, missed_rate=missed_rate)


def above(n: int) -> tuple[int, ...]:
    """The n poses next to the one above the place."""
    gap_m = np.linalg.norm(flat_workspace().positions_m[:, :2] - PLACE_M[:2], axis=1)
    # Four poses are as near as each other: in the order of their numbers, whatever the processor sorts by.
    return tuple(int(pose) for pose in np.argsort(gap_m.round(9), kind="stable")[:n])


def test_a_lesion_may_hide_where_a_view_that_misses_some_has_looked() -> None:
    trusting, doubting = (
        FindAndOutline().search_score(situation_with(0.001, above(1), missed)) for missed in (0.0, 0.3)
    )
    for beside in above(4)[1:]:
        # By a tenth at least: from 13 mm aside two thirds of the balls are others.
        assert doubting[beside] > 1.1 * trusting[beside]


def test_a_finding_in_doubt_is_looked_at_again() -> None:
    pose = above(2)[1]
    exact = FindAndOutline().outline_score(situation_with(0.6, above(1), 0.0))
    doubtful = FindAndOutline().outline_score(situation_with(0.6, above(1), 0.1))
    assert doubtful[pose] > exact[pose]


def test_a_finding_is_looked_at_three_times_and_no_more() -> None:
    points_m, probability = PLACE_M[None], np.array([0.6])
    for n_looks, is_open in ((1, True), (2, True), (3, False), (5, False)):
        situation = situation_with(0.6, above(n_looks), 0.1)
        assert unconfirmed_points(situation, points_m, probability, 0.007)[0] == is_open


def test_what_is_confirmed_nearby_is_no_suspect() -> None:
    situation = situation_with(0.6, above(1), 0.1)
    points_m = np.array([PLACE_M, PLACE_M + 0.003])
    assert not unconfirmed_points(situation, points_m, np.array([0.6, 0.95]), 0.007).any()
    assert unconfirmed_points(situation, points_m, np.array([0.6, 0.7]), 0.007).all()


def free_views(n_views: int, n_points: int, weight: float | None) -> tuple[LabelledPoints, ...]:
    """Views that call all of a box free, each label wrong by a chance of 0.3."""
    rng, low_m, high_m = np.random.default_rng(0), (-0.08, -0.08, -0.08), (0.08, 0.08, -0.01)
    return tuple(
        LabelledPoints(
            rng.uniform(low_m, high_m, (n_points, 3)),
            np.zeros(n_points, bool),
            np.full(n_points, np.log(0.3)),
            None if weight is None else np.full(n_points, weight),
        )
        for _ in range(n_views)
    )


def sixty_balls() -> HiddenBalls:
    return hidden_balls(flat_workspace(), make_situation().cone, box_points(), None, BallPrior(n_balls=60))


def test_labels_that_err_each_by_itself_leave_the_product_of_their_chances() -> None:
    """By a plain loop over balls and points."""
    balls, readings = sixty_balls(), free_views(3, 400, None)
    expected = balls.weights.astype(float)
    for reading in readings:
        for number, (centre_m, radius_m) in enumerate(zip(balls.centres_m, balls.radii_m, strict=True)):
            held = np.linalg.norm(reading.points_m - centre_m, axis=1) <= radius_m
            expected[number] *= 0.3 ** held.sum()
    np.testing.assert_allclose(still_hiding(balls, readings, 0.0), expected, rtol=1e-6)


def test_views_that_miss_lesions_as_a_whole_have_one_vote_each_about_a_ball() -> None:
    """Drawn by chance: of views of a lesion some miss it, and of the others some draw its edge inside the label."""
    rng, n_draws = np.random.default_rng(1), 200_000
    balls, readings = sixty_balls(), free_views(2, 400, 0.01)
    left = still_hiding(balls, readings, 0.0) / balls.weights
    for number in range(0, len(left), 6):
        is_free = np.ones(n_draws, bool)
        for reading in readings:
            gap_m = np.linalg.norm(reading.points_m - balls.centres_m[number], axis=1).min()
            depth_m = balls.radii_m[number] - gap_m
            if depth_m >= 0.0:
                drawn_beyond_m = rng.normal(0.0, 0.0015, n_draws)
                is_free &= (rng.random(n_draws) < 0.3) | (drawn_beyond_m > depth_m)
        # Four standard errors of a share of so many draws.
        assert left[number] == pytest.approx(is_free.mean(), abs=4 * 0.5 / np.sqrt(n_draws))


def test_many_labels_of_a_view_that_errs_as_a_whole_say_no_more_than_one() -> None:
    balls = sixty_balls()
    left = still_hiding(balls, free_views(1, 100_000, 0.01), 0.0) / balls.weights
    np.testing.assert_allclose(left, 0.3, rtol=1e-2)


def test_a_reading_that_does_not_say_is_taken_by_the_rate_also_beside_one_that_does() -> None:
    balls = sixty_balls()
    points_m = np.random.default_rng(0).uniform((-0.08, -0.08, -0.08), (0.08, 0.08, -0.01), (400, 3))
    silent = LabelledPoints(points_m, np.zeros(400, bool))
    says_nothing = LabelledPoints(points_m, np.zeros(400, bool), np.zeros(400))
    for rate in (0.0, 0.2):
        np.testing.assert_allclose(
            still_hiding(balls, (silent, says_nothing), rate), still_hiding(balls, (silent,), rate), rtol=1e-9
        )

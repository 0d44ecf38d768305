"""Suspects of find-and-outline: what one view called tumour is looked at again until views agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit, logit

from mapping import LabelledPoints
from planner import FindAndOutline
from planner.find_and_outline.suspects import suspects
from tests.helpers.planner_situations import box_points, flat_workspace, make_situation

PLACE_M = np.array([0.0, 0.0, -0.05])
SAW, MISSED = 6.6, -2.5
MARGIN_M = 0.007
LIKELY_M, NOWHERE_M = PLACE_M + np.random.default_rng(2).uniform(-0.008, 0.008, (500, 3)), np.empty((0, 3))


def view(log_odds: float, seed: int = 0) -> LabelledPoints:
    """A hundred labels around the place that all say the same."""
    points_m = PLACE_M + np.random.default_rng(seed).uniform(-0.006, 0.006, (100, 3))
    said = np.full(100, log_odds)
    return LabelledPoints(points_m, said > 0.0, said, np.full(100, 0.01))


def situation_of(*views: LabelledPoints):
    """A map that knows of nothing, and views from the poses next to the place."""
    points_m = box_points()
    gap_m = np.linalg.norm(flat_workspace().positions_m[:, :2] - PLACE_M[:2], axis=1)
    sensed = tuple(int(pose) for pose in np.argsort(gap_m.round(9), kind="stable")[: len(views)])
    nothing = np.full(len(points_m), logit(0.001))
    situation = make_situation(points=points_m, mean=nothing, variance=np.zeros(len(points_m)), sensed=sensed)
    return replace(situation, readings=views, missed_rate=0.08)


@pytest.mark.parametrize(
    ("said", "is_suspect"),
    [
        ((SAW,), True),
        ((SAW, MISSED), True),
        ((MISSED, SAW), True),
        ((SAW, MISSED, MISSED), False),
        ((SAW, SAW), False),
        ((SAW, SAW, MISSED), False),
        ((MISSED,), False),
        # Two of four views missed it, and it is tumour by 0.987 all the same; the fifth view decides.
        ((MISSED, SAW, SAW, MISSED), True),
        ((MISSED, SAW, SAW, MISSED, SAW), False),
        # After four views 0.43 is no suspect, after seven 0.71 is one, and after eight it is none.
        ((SAW, -1.0, -1.0, -1.0), False),
        ((SAW, *(-0.3,) * 6), True),
        ((SAW, *(-0.3,) * 7), False),
    ],
)
def test_a_place_is_a_suspect_until_votes_decide(said: tuple[float, ...], is_suspect: bool) -> None:
    """The map takes it for likely: only the votes have to decide."""
    found = suspects(situation_of(*(view(each) for each in said)), LIKELY_M, MARGIN_M)
    assert bool(len(found.points_m)) == is_suspect


@pytest.mark.parametrize(("n_views", "is_suspect"), [(2, True), (7, True), (8, False)])
def test_what_the_map_drowns_is_a_suspect_though_the_votes_are_sure(n_views: int, is_suspect: bool) -> None:
    """A lesion that two views grazed and two missed was given up with a probability of 0.998 by the votes: the map, in
    which the two that missed it had the more labels, said 0.23."""
    said = (SAW, SAW, *(-0.1,) * (n_views - 2))
    found = suspects(situation_of(*(view(each) for each in said)), NOWHERE_M, MARGIN_M)
    assert bool(len(found.points_m)) == is_suspect
    far_m = PLACE_M[None] + 0.05
    elsewhere = suspects(situation_of(*(view(each) for each in said)), far_m, MARGIN_M)
    assert len(elsewhere.points_m) == len(found.points_m)


def test_what_the_votes_confirm_and_the_map_drowns_is_outlined_on() -> None:
    planner, asked = FindAndOutline(), situation_of(view(SAW), view(SAW))
    beside = situation_of(view(SAW), view(SAW), view(SAW)).sensed[-1]
    assert planner.outline_score(asked)[beside] > planner.least_gain_m3


def test_a_suspect_is_as_likely_as_bayes_rule_says() -> None:
    found = suspects(situation_of(view(SAW), view(MISSED)), NOWHERE_M, MARGIN_M)
    np.testing.assert_allclose(found.probability, expit(logit(0.02) + SAW + MISSED))


def test_a_suspect_draws_a_look_though_the_map_knows_of_nothing() -> None:
    planner, pose = FindAndOutline(), situation_of(view(SAW)).sensed[0]
    doubted, dropped = (
        planner.outline_score(situation_of(view(SAW), *(view(MISSED) for _ in range(n)))) for n in (1, 2)
    )
    beside = situation_of(view(SAW), view(MISSED), view(MISSED)).sensed[-1]
    assert doubted[beside] > planner.least_gain_m3
    assert doubted[pose] > 0.0
    assert not dropped.any()


def test_what_is_confirmed_nearby_is_no_suspect() -> None:
    """The second view sees one half of the place only."""
    whole, half = view(SAW), view(SAW, seed=1)
    left = half.points_m[:, 0] < PLACE_M[0]
    assert half.log_odds is not None
    assert half.weight is not None
    half = LabelledPoints(half.points_m[left], half.is_occupied[left], half.log_odds[left], half.weight[left])
    assert len(suspects(situation_of(whole, half), LIKELY_M, MARGIN_M).points_m) == 0
    assert len(suspects(situation_of(whole, half), LIKELY_M, 1e-6).points_m) > 0

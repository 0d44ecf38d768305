"""Rims in doubt draw another look, where outlines stray by view and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import logit

from planner import FindAndOutline
from planner.find_and_outline.fine_lattice import fine_lattice
from planner.find_and_outline.frontier import probability_at
from planner.find_and_outline.rims import rim_score
from tests.helpers.planner_situations import box_points, flat_workspace, make_situation

PLACE_M = np.array([0.0, 0.0, -0.05])


def situation_with(sensed: tuple[int, ...], missed_rate: float):
    """A ball that the map is sure of, in a shell of doubt."""
    points_m = box_points()
    gap_m = np.linalg.norm(points_m - PLACE_M, axis=1)
    chance = np.where(gap_m < 0.015, 0.99, np.where(gap_m < 0.03, 0.4, 0.001))
    situation = make_situation(
        points=points_m, mean=logit(chance), variance=np.zeros(len(points_m)), sensed=sensed
    )
    return replace(situation, missed_rate=missed_rate)


def rim_of(situation):
    lattice = fine_lattice(situation.search_points_m)
    return rim_score(situation, lattice, probability_at(lattice, situation.prediction))


def above(n: int) -> tuple[int, ...]:
    gap_m = np.linalg.norm(flat_workspace().positions_m[:, :2] - PLACE_M[:2], axis=1)
    return tuple(int(pose) for pose in np.argsort(gap_m)[:n])


def test_a_rim_is_worth_what_a_plain_loop_over_places_sums() -> None:
    situation = situation_with(above(3), 0.1)
    lattice, cone, workspace = fine_lattice(situation.search_points_m), situation.cone, situation.workspace
    probability = probability_at(lattice, situation.prediction)

    def sees(pose: int) -> np.ndarray:
        return cone.contains(lattice.points_m, workspace.positions_m[pose], workspace.normals[pose])

    n = np.sum([sees(pose) for pose in situation.sensed], axis=0)
    doubt = np.where(
        (probability > 0.05) & (probability < 0.95), np.minimum(probability, 1 - probability), 0.0
    )
    worth = np.where(n > 0, doubt * (1 - np.sqrt(n / (n + 1))), 0.0)
    rim = rim_of(situation)
    for pose in above(8):
        np.testing.assert_allclose(rim[pose], lattice.cell_m3 * worth[sees(pose)].sum(), rtol=1e-9)
    assert rim[above(1)[0]] > 0.0


def test_rims_are_worth_nothing_where_views_miss_nothing_and_before_any_view() -> None:
    assert not rim_of(situation_with(above(3), 0.0)).any()
    assert not rim_of(situation_with((), 0.1)).any()


def test_a_rim_that_many_views_drew_is_worth_less() -> None:
    few, many = (rim_of(situation_with(above(1) * n, 0.1))[above(1)[0]] for n in (1, 6))
    assert 0.0 < many < few / 3


def test_rims_count_for_the_next_pose_and_not_for_what_has_to_be_outlined() -> None:
    """The score has three parts; of an outline alone it is said whether something is left to outline."""
    situation, planner = situation_with(above(3), 0.1), FindAndOutline(hidden_ratio=0.0)
    outlined = planner.outline_score(situation)
    expected = planner.hidden_m3 * planner.search_score(situation) + rim_of(situation)
    is_outlined = outlined >= planner.least_gain_m3
    np.testing.assert_allclose(planner.score(situation), expected + np.where(is_outlined, outlined, 0.0))

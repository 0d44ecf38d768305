"""A finding that the map calls in one place alone is looked at again; one with extent, or where labels err, is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logit

from planner import FindAndOutline, PlannerError
from planner.find_and_outline.faint_findings import faint_score
from planner.find_and_outline.fine_lattice import fine_lattice
from planner.visibility import visibility
from tests.helpers.planner_situations import box_points, flat_workspace, make_situation

POINTS_M = box_points()
WORKSPACE = flat_workspace()


def nearest_point(place_m: tuple[float, float, float]) -> int:
    return int(np.argmin(np.linalg.norm(POINTS_M - place_m, axis=1)))


def called_at(*called: int, n_looks: int = 1):
    """A map that calls some search points and nothing else, after some looks from beside the first of them."""
    chance = np.full(len(POINTS_M), 0.001)
    chance[list(called)] = 0.9
    place_m = POINTS_M[called[0]] if called else POINTS_M[0]
    holds = [
        pose
        for pose in range(WORKSPACE.n_poses)
        if make_situation().cone.contains(
            place_m[None], WORKSPACE.positions_m[pose], WORKSPACE.normals[pose]
        )[0]
    ]
    return make_situation(
        points=POINTS_M,
        mean=logit(chance),
        variance=np.zeros(len(POINTS_M)),
        sensed=tuple(holds[:n_looks]),
    )


def faint_of(situation):
    return faint_score(situation, fine_lattice(situation.search_points_m))


MIDDLE = nearest_point((0.0, 0.0, -0.05))
BESIDE = nearest_point(tuple(POINTS_M[MIDDLE] + [np.diff(np.unique(POINTS_M[:, 0])).min(), 0.0, 0.0]))


def test_a_pose_is_worth_the_share_of_the_surroundings_that_its_cone_holds() -> None:
    situation = called_at(MIDDLE)
    faint, cone, lattice_m = faint_of(situation), situation.cone, fine_lattice(POINTS_M).points_m
    place_m = POINTS_M[MIDDLE]
    around_m = np.vstack([place_m, lattice_m[np.linalg.norm(lattice_m - place_m, axis=1) <= 0.004]])
    for pose in range(0, WORKSPACE.n_poses, 7):
        share = cone.contains(around_m, WORKSPACE.positions_m[pose], WORKSPACE.normals[pose]).mean()
        assert faint[pose] == pytest.approx(share)
    assert faint.max() == pytest.approx(1.0)


def test_a_finding_with_extent_and_one_looked_at_often_enough_draw_no_look() -> None:
    assert not faint_of(called_at(MIDDLE, BESIDE)).any()
    assert faint_of(called_at(MIDDLE, n_looks=2)).any()
    assert not faint_of(called_at(MIDDLE, n_looks=3)).any()


def test_two_faint_findings_count_both() -> None:
    other = nearest_point((0.04, 0.03, -0.05))
    both, one = faint_of(called_at(MIDDLE, other)), faint_of(called_at(MIDDLE))
    assert both.sum() > 1.5 * one.sum()
    assert (both >= one - 1e-9).all()


def test_looks_that_were_in_vain_so_often_tell_that_labels_are_wrong() -> None:
    step_m = np.diff(np.unique(POINTS_M[:, 0])).min()
    below_m, cone = POINTS_M[MIDDLE], make_situation().cone
    near = np.flatnonzero(np.linalg.norm(POINTS_M - below_m, axis=1) < 8.0 * step_m)
    near = near[visibility(WORKSPACE, cone, POINTS_M[near]).sum(axis=1) >= 3]
    lone = [MIDDLE]
    for place in near:
        if np.linalg.norm(POINTS_M[lone] - POINTS_M[place], axis=1).min() > 2.5 * step_m:
            lone.append(int(place))
    lone, other = lone[:5], nearest_point((0.05, 0.05, -0.05))
    assert len(lone) == 5
    looks = visibility(WORKSPACE, cone, POINTS_M[lone])
    sensed = np.unique([np.flatnonzero(looks[place])[:3] for place in range(5)])
    for n_vain, looks_on in ((4, True), (5, False)):
        situation = replace(called_at(*lone[:n_vain], other), sensed=tuple(sensed.tolist()))
        assert faint_of(situation).any() == looks_on


def test_nothing_is_faint_where_labels_may_be_wrong_before_any_look_and_without_a_finding() -> None:
    situation = called_at(MIDDLE)
    for name in ("missed_rate", "false_positive_rate", "false_negative_rate"):
        assert not faint_of(replace(situation, **{name: 0.05})).any()
    assert not faint_of(called_at(MIDDLE, n_looks=0)).any()
    assert not faint_of(called_at()).any()


def test_the_next_pose_looks_at_the_faint_finding_and_without_the_share_it_does_not() -> None:
    situation = called_at(MIDDLE)
    looks = faint_of(situation)
    with_share, without = (FindAndOutline(faint_share=share) for share in (0.1, 0.0))
    gain = with_share.score(situation) - without.score(situation)
    hidden_m3 = gain[looks > 0.0] / looks[looks > 0.0] / 0.1
    np.testing.assert_allclose(hidden_m3, hidden_m3[0], rtol=1e-6)
    assert looks[next(iter(with_share.rank(situation)))] > 0.5


def test_a_share_that_is_no_number_or_below_0_is_refused() -> None:
    for share in (-0.1, float("nan"), float("inf")):
        with pytest.raises(PlannerError, match="`faint_share` must be 0 or above and finite"):
            FindAndOutline(faint_share=share)

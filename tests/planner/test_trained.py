"""The trained planner against sums by hand, its limits, and the numbers that are shipped."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from planner_situations import box_points, make_situation

from mapping import LabelledPoints
from planner import GreedyCoverage, PlannerError, Trained
from planner.trained.features import (
    CONE_KNOTS_M,
    DEPTH_KNOTS_M,
    FOUND_M3,
    N_OUTLINE,
    N_SEARCH,
    NEARER_KNOTS_M,
    TUMOUR_KNOTS_M,
    hats,
    search_lattice,
)

SPACING_M = 0.0041
"""Below that to which a lattice is refined, and such that no distance between points is a knot."""
AXIS_M = SPACING_M * np.arange(-5.5, 6.0)
POINTS = np.stack(np.meshgrid(AXIS_M, AXIS_M, AXIS_M - 0.04, indexing="ij"), axis=-1).reshape(-1, 3)
NOTHING_TO_OUTLINE = (-60.0,) * len(TUMOUR_KNOTS_M) + (0.0,) * (N_OUTLINE - len(TUMOUR_KNOTS_M))


def reading_of(situation, pose, tumour_m, radius_m):
    """The search points in the cone of a pose, called tumour within a ball."""
    points_m = held(situation, pose, situation.search_points_m)
    return LabelledPoints(points_m, np.linalg.norm(points_m - tumour_m, axis=1) < radius_m)


def held(situation, pose, points_m):
    return points_m[contains(situation, pose, points_m)]


def contains(situation, pose, points_m):
    workspace = situation.workspace
    return situation.cone.contains(points_m, workspace.positions_m[pose], workspace.normals[pose])


def by_hand(situation, weights):
    """The score, pose by pose and place by place."""
    lattice = search_lattice(situation.search_points_m)
    tumour_m = np.concatenate([each.points_m[each.is_occupied] for each in situation.readings])
    free_m = np.concatenate([each.points_m[~each.is_occupied] for each in situation.readings])
    cell_m3 = SPACING_M**3
    to_tumour = np.linalg.norm(POINTS[:, None] - tumour_m, axis=2).min(axis=1)
    found = math.log1p(cell_m3 * (to_tumour <= TUMOUR_KNOTS_M[1]).sum() / FOUND_M3)
    places, worths = [], []
    for index in lattice.chosen:
        gap_m = min(face_distance(situation, pose, POINTS[index]) for pose in situation.sensed)
        depth_m = situation.surface_distance_m[index]
        log_worth = np.interp(gap_m, CONE_KNOTS_M, [*weights[:4], 0.0])
        log_worth += np.interp(depth_m, DEPTH_KNOTS_M, [*weights[4:7], 0.0]) + weights[7] * found
        places.append(POINTS[index])
        worths.append(0.0 if gap_m <= 0.0 else lattice.cell_m3 * math.exp(log_worth))
    outline = weights[N_SEARCH:]
    for index in np.flatnonzero(to_tumour <= TUMOUR_KNOTS_M[-1]):
        if min(face_distance(situation, pose, POINTS[index]) for pose in situation.sensed) <= 0.0:
            continue
        nearer_m = np.linalg.norm(free_m - POINTS[index], axis=1).min() - to_tumour[index]
        log_worth = np.interp(to_tumour[index], TUMOUR_KNOTS_M, outline[:5])
        log_worth += np.interp(nearer_m, NEARER_KNOTS_M, [outline[5], 0.0, outline[6]])
        places.append(POINTS[index])
        worths.append(cell_m3 * math.exp(log_worth))
    places, worths = np.array(places), np.array(worths)
    return np.array(
        [worths[contains(situation, pose, places)].sum() for pose in range(situation.workspace.n_poses)]
    )


def face_distance(situation, pose, point_m):
    """The larger of the signed distances to mantle and base of a pose's cone."""
    offset_m = point_m - situation.workspace.positions_m[pose]
    axial_m = offset_m @ situation.workspace.normals[pose]
    lateral_m = np.linalg.norm(offset_m - axial_m * situation.workspace.normals[pose])
    alpha = situation.cone.half_angle_rad
    return max(lateral_m * math.cos(alpha) - axial_m * math.sin(alpha), axial_m - situation.cone.depth_m)


@pytest.fixture
def met():
    """A tumour at the edge of the cone of pose 189, the second that was sensed."""
    situation = make_situation(points=POINTS, sensed=(85, 189))
    workspace = situation.workspace
    tumour_m = workspace.positions_m[189] + [0.011, 0.0, -0.04]
    readings = tuple(reading_of(situation, pose, tumour_m, 0.008) for pose in situation.sensed)
    assert readings[1].is_occupied.any()
    depth_m = np.abs(POINTS[:, 2] + 0.062)
    return replace(situation, readings=readings, surface_distance_m=depth_m)


@pytest.mark.parametrize("seed", range(3))
def test_the_score_is_the_sum_by_hand(met, seed):
    weights = np.random.default_rng(seed).normal(size=N_SEARCH + N_OUTLINE)
    score = Trained(weights=tuple(weights)).score(met)
    # Distances to cones are in single precision.
    assert score == pytest.approx(by_hand(met, weights), rel=1e-4)


def test_with_nothing_learned_it_is_greedy_coverage_of_places_8_mm_apart():
    points = box_points()  # 13 mm apart: all of them are searched
    situation = make_situation(points=points, sensed=(7, 210))
    planner = Trained(weights=(0.0,) * N_SEARCH + NOTHING_TO_OUTLINE)
    score, coverage = planner.score(situation), GreedyCoverage().score(situation)
    assert score == pytest.approx(search_lattice(points).cell_m3 * coverage)
    assert next(planner.rank(situation)) == next(GreedyCoverage().rank(situation))


def test_it_goes_on_beside_a_tumour_that_a_cone_grazed(met):
    chosen = next(Trained().rank(met))
    step_m = met.workspace.positions_m[chosen] - met.workspace.positions_m[189]
    # Towards the tumour, whose middle lies 11 mm along x, and no farther than its other side.
    assert 0.0 < step_m[0] < 0.025
    assert abs(step_m[1]) < 0.015


def test_hats_make_a_piecewise_linear_function_that_ends_flat():
    knots, values = (0.0, 1.0, 4.0), np.array([2.0, -1.0, 5.0])
    at = np.array([-3.0, 0.0, 0.25, 1.0, 3.0, 4.0, np.inf])
    assert hats(at, knots) @ values == pytest.approx(np.interp(at, knots, values))


def test_the_shipped_numbers_say_how_they_were_learned():
    told = json.loads(files("planner.trained").joinpath("weights.json").read_text())
    assert "benchmarks.train_baseline" in told["learned_by"]
    assert Trained().weights == (*told["search"], *told["outline"])
    assert (len(told["search"]), len(told["outline"])) == (N_SEARCH, N_OUTLINE)


@pytest.mark.parametrize("weights", [(), (1.0,) * (N_SEARCH + N_OUTLINE - 1) + (math.nan,)])
def test_numbers_that_are_not_whole_are_refused(weights):
    with pytest.raises(PlannerError, match=f"`weights` must be {N_SEARCH + N_OUTLINE} finite numbers"):
        Trained(weights=weights)

"""The stop: the count of lesions, the posterior over those that are left, and when to go on is not worth it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from planner_situations import flat_workspace
from scipy.stats import nbinom
from searched import CONE, PLANNER, blob, play, seen_free, situation

from mapping import LabelledPoints
from planner import FindAndOutline, LesionPrior, PlannerError
from planner.find_and_outline.still_hiding import still_hiding
from planner.stopping.expectation import is_worth_searching, what_is_left
from planner.stopping.hidden_lesions import hidden_lesions
from planner.stopping.lesion_count import labels_per_m3, n_lesions

SMALL = LesionPrior(median_diameter_m=0.012, diameter_spread=0.2)

# --- the count ---


def unit_vectors(rng, n):
    way = rng.normal(size=(n, 3))
    return way / np.linalg.norm(way, axis=1)[:, None]


def planted_points(rng, *, diameter_m, gap_m=None, spacing_m=0.004):
    """Likely tumour and free labels, strewn by chance, of one ball or of two that are a gap apart."""
    [way] = unit_vectors(rng, 1)
    half_m = 0.0 if gap_m is None else (diameter_m + gap_m) / 2.0
    centres_m = np.array([-half_m * way, half_m * way])[: 1 if gap_m is None else 2]
    side_m = 2.0 * half_m + diameter_m + 0.02
    points_m = rng.uniform(-side_m / 2, side_m / 2, (int(4.0 * (side_m / spacing_m) ** 3), 3))
    is_tumour = (np.linalg.norm(points_m[:, None] - centres_m, axis=2) <= diameter_m / 2).any(axis=1)
    return points_m[is_tumour], points_m[~is_tumour]


def test_a_reading_without_points_is_one_of_which_little_follows() -> None:
    """A sensor may see nothing at all, where contact is lost; the count then goes on as before the first action."""
    nothing = LabelledPoints(np.empty((0, 3)), np.empty(0, dtype=bool))
    assert labels_per_m3(CONE, [nothing]) == labels_per_m3(CONE, []) > 0.0
    seen = situation(workspace=flat_workspace(), readings=(nothing,), sensed=(0,))
    assert 0.0 <= PLANNER.confidence(seen) < 1.0
    assert next(iter(PLANNER.rank(seen))) >= 0


@pytest.mark.parametrize(
    ("diameter_m", "gap_m"), [(0.010, 0.012), (0.010, 0.017), (0.024, 0.012), (0.024, 0.017)]
)
def test_tumours_12_and_17_mm_apart_are_two(diameter_m, gap_m):
    """They were one, since cubes of a centimetre that touched by a corner were taken together."""
    for seed in range(20):
        tumour_m, free_m = planted_points(np.random.default_rng(seed), diameter_m=diameter_m, gap_m=gap_m)
        assert n_lesions(tumour_m, free_m, 0.004) == 2


@pytest.mark.parametrize("diameter_m", [0.008, 0.016, 0.040])
def test_one_tumour_is_one(diameter_m):
    for seed in range(20):
        tumour_m, free_m = planted_points(np.random.default_rng(seed), diameter_m=diameter_m)
        assert n_lesions(tumour_m, free_m, 0.004) == 1


def test_labels_that_lie_apart_are_one_lesion_where_nothing_free_was_seen_between_them():
    ends_m = np.array([[0.0, 0.0, 0.0], [0.009, 0.0, 0.0]])
    between_m, beside_m = np.array([[0.0045, 0.002, 0.0]]), np.array([[0.0045, 0.006, 0.0]])
    assert n_lesions(ends_m, np.empty((0, 3)), 0.004) == 1
    assert n_lesions(ends_m, beside_m, 0.004) == 1
    assert n_lesions(ends_m, between_m, 0.004) == 2
    assert n_lesions(ends_m * 1.5, beside_m, 0.004) == 2  # 13.5 mm are more than three spacings
    assert n_lesions(ends_m / 2.0, between_m / 2.0, 0.004) == 1  # 4.5 mm are within one and a half
    assert n_lesions(np.empty((0, 3)), beside_m, 0.004) == 0


# --- the prior and the posterior ---


def test_the_prior_has_the_quartiles_of_the_lits_patients():
    prior = LesionPrior()
    p = prior.number_shape / (prior.number_shape + prior.mean_number)
    assert nbinom.ppf([0.25, 0.5, 0.75], prior.number_shape, p).tolist() == [1, 3, 9]
    diameters_m = prior.diameters_m(1001)
    assert diameters_m[500] == pytest.approx(0.016)
    assert np.std(np.log(LesionPrior(diameter_spread=0.3).diameters_m(4000))) == pytest.approx(0.3, abs=0.01)
    assert (diameters_m.min(), diameters_m.max()) == prior.diameter_range_m


def test_what_is_left_is_what_is_left_among_patients_of_the_prior():
    """By another way: numbers drawn from the prior, each lesion found with the share C, and k found in all."""
    workspace, sensed = flat_workspace(), (90, 210, 305, 44, 388)
    readings = seen_free(workspace, sensed)
    asked = situation(workspace=workspace, sensed=sensed, readings=readings)
    prior = replace(SMALL, mean_number=2.0, number_shape=0.8)
    lesions = hidden_lesions(asked, prior)
    points_m = np.concatenate([reading.points_m for reading in readings])
    gap_m = np.linalg.norm(lesions.balls.centres_m[:, None] - points_m, axis=2).min(axis=1)
    share = float(np.mean(gap_m <= lesions.balls.radii_m))
    rng = np.random.default_rng(3)
    number = rng.poisson(rng.gamma(0.8, 2.0 / 0.8, 400_000))
    found = rng.binomial(number, share)
    for k in (0, 1, 3):
        told, left = what_is_left(asked, prior, k), (number - found)[found == k]
        assert told.n_found == k
        # Four standard errors of some 10,000 draws and more.
        beyond = told.expected_unseeable
        assert told.expected_left + beyond == pytest.approx(
            left.mean(), abs=4 * left.std() / math.sqrt(len(left))
        )
        if told.unseeable_share == 0.0:
            assert told.chance_of_none == pytest.approx(
                np.mean(left == 0), abs=4 * 0.5 / math.sqrt(len(left))
            )


def test_lesions_have_the_sizes_of_the_prior_lie_inside_and_no_pose_finds_the_unseeable():
    workspace = flat_workspace(8)
    asked = situation(workspace=workspace)
    asked = replace(asked, surface_distance_m=np.full(len(asked.search_points_m), 0.02))
    lesions = hidden_lesions(asked, SMALL)
    radii_m, centres_m = lesions.balls.radii_m, lesions.balls.centres_m
    np.testing.assert_allclose(np.sort(2.0 * radii_m), SMALL.diameters_m(len(radii_m)))
    can_be_found = lesions.can_be_found(asked.available(exclude_sensed=False))
    told = what_is_left(asked, SMALL, 0)
    assert told.unseeable_share == pytest.approx(1.0 - can_be_found.mean())
    assert 0.05 < told.unseeable_share < 0.95
    # By another way: no cone holds a point of the ball of half the radius.
    way = unit_vectors(np.random.default_rng(0), 60)
    n_equal = 0
    for ball in range(0, len(radii_m), 40):
        shell_m = np.vstack([centres_m[ball], centres_m[ball] + 0.49 * radii_m[ball] * way])
        poses = zip(workspace.positions_m, workspace.normals, strict=True)
        is_held = any(CONE.contains(shell_m, at_m, normal).any() for at_m, normal in poses)
        assert can_be_found[ball] or not is_held
        n_equal += can_be_found[ball] == is_held
    assert n_equal >= 47  # of 50; 60 directions miss a graze, and beyond an edge the distance is too small
    none = replace(asked, skipped=frozenset(range(workspace.n_poses)))
    assert what_is_left(none, SMALL, 0).unseeable_share == 1.0


def test_the_chance_of_missing_a_lesion_is_that_of_no_label_in_it():
    workspace = flat_workspace(3)
    asked = situation(workspace=workspace)
    lesions, rng = (
        hidden_lesions(asked, LesionPrior(median_diameter_m=0.008, diameter_spread=0.0)),
        np.random.default_rng(1),
    )
    missed = lesions.chance_of_missing(workspace, CONE, [4], 4e6)[0]
    # Away from tip, edge and base, where a face is not flat, and only where the face cuts the ball or holds it.
    depth_m = workspace.positions_m[4, 2] - lesions.balls.centres_m[:, 2]
    some = np.flatnonzero((missed < 0.999) & (depth_m > 0.05) & (depth_m < 0.08))
    assert len(some) >= 5
    for ball in some[:20]:
        inside_m = (
            0.004 * np.cbrt(rng.random((4000, 1))) * unit_vectors(rng, 4000) + lesions.balls.centres_m[ball]
        )
        share = CONE.contains(inside_m, workspace.positions_m[4], workspace.normals[4]).mean()
        expected = math.exp(-4e6 * share * 4.0 / 3.0 * math.pi * 0.004**3)
        assert missed[ball] == pytest.approx(
            expected, abs=0.07
        )  # the mantle is round, the formula's face flat


# --- worth ---


def test_some_prefix_of_the_search_has_to_be_worth_its_actions():
    workspace, sensed = flat_workspace(), (0,)
    readings = seen_free(workspace, sensed)
    asked = situation(workspace=workspace, sensed=sensed, readings=readings)
    lesions = hidden_lesions(asked, SMALL)
    density = labels_per_m3(CONE, readings)
    hiding = still_hiding(lesions.balls, readings, 0.0)
    gain = (1.0 - lesions.chance_of_missing(workspace, CONE, [0, 210], density)) @ hiding
    shape, rate = SMALL.rate(0, 1.0 - hiding.sum())
    # The first pose sees what was seen, and is worth next to nothing; from here on both are worth two actions.
    assert gain[0] < 0.2 * gain[1]
    worth_two = 2.0 / (gain.sum() * shape / rate)
    assert is_worth_searching(asked, SMALL, 0, [0, 210], 1.3 * worth_two)
    assert not is_worth_searching(asked, SMALL, 0, [0], 1.3 * worth_two)
    assert not is_worth_searching(asked, SMALL, 0, [0, 210], 0.7 * worth_two)
    assert not is_worth_searching(asked, SMALL, 0, [], 1e9)


def test_it_goes_on_the_longer_the_more_a_miss_costs_and_the_more_was_found():
    workspace = flat_workspace()
    sensed, _ = play(PLANNER, 40, workspace)
    readings = seen_free(workspace, sensed)

    def last_worth(miss_cost):
        for n in range(1, 41):
            asked = situation(workspace=workspace, sensed=sensed[:n], readings=readings[:n])
            if not PLANNER.is_worth_going_on(replace(asked, miss_cost=miss_cost)):
                return n
        return 41

    ends = [last_worth(miss_cost) for miss_cost in (1.0, 10.0, 60.0, 1e6)]
    assert ends == sorted(ends)
    assert ends[0] < ends[2] < ends[3] == 41
    asked = situation(workspace=workspace, sensed=sensed[: ends[2]], readings=readings[: ends[2]])
    plan = sensed[ends[2] :]
    assert is_worth_searching(asked, PLANNER.lesions, 8, plan, 60.0)
    # Where nobody says what a miss costs, and before the first action, it goes on.
    assert PLANNER.is_worth_going_on(asked)
    assert PLANNER.is_worth_going_on(replace(situation(workspace=workspace), miss_cost=1e-6))


def test_where_the_search_is_not_worth_it_what_was_found_is_still_outlined():
    workspace = flat_workspace()
    centre_m = np.array([0.05, 0.05, -0.03])
    asked = situation(
        workspace=workspace, mean=blob(centre_m, 0.02), sensed=(0,), readings=seen_free(workspace, (0,))
    )
    cheap = replace(asked, miss_cost=1e-6)
    assert PLANNER.is_worth_going_on(cheap)
    assert PLANNER.outline_score(asked)[next(iter(PLANNER.rank(cheap)))] == PLANNER.outline_score(asked).max()
    nothing = replace(
        situation(workspace=workspace, sensed=(0,), readings=seen_free(workspace, (0,))), miss_cost=1e-6
    )
    assert not PLANNER.is_worth_going_on(nothing)
    assert len(list(PLANNER.rank(nothing))) == workspace.n_poses - 1


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("mean_number", 0.0),
        ("number_shape", math.inf),
        ("median_diameter_m", 0.2),
        ("diameter_spread", -0.1),
        ("diameter_range_m", (0.02, 0.01)),
    ],
)
def test_a_prior_out_of_range_is_refused(field, value):
    with pytest.raises(PlannerError, match=f"`{field}` must"):
        LesionPrior(**{field: value})
    assert FindAndOutline().lesions == LesionPrior()

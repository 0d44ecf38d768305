"""Readings that were taken beside where they were measured are moved to where their labels fit each other's."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from mapping import LabelledPoints
from mapping.registration import ReadingShifts, reading_shifts

DEVIATION_M = 0.003
RADIUS_M = 0.012
BEAM = np.array([0.0, 0.0, -1.0])


def slanted(rng) -> np.ndarray:
    """A beam within some 30 degrees of straight down."""
    beam = BEAM + 0.3 * rng.standard_normal(3)
    return beam / np.linalg.norm(beam)


def true_points_m(rng, n=800) -> np.ndarray:
    return rng.uniform([-0.03, -0.03, -0.05], [0.03, 0.03, 0.0], (n, 3))


def in_ball(points_m) -> np.ndarray:
    return np.linalg.norm(points_m - [0.003, -0.002, -0.025], axis=1) < RADIUS_M


def measured(rng, n, *, is_tumour=in_ball):
    """Readings as they were measured, their beams, and the shifts that bring them back."""
    readings, beams, shifts_m = [], [], []
    for _ in range(n):
        points_m, beam = true_points_m(rng), slanted(rng)
        shift_m = DEVIATION_M * rng.standard_normal(3)
        shift_m -= (shift_m @ beam) * beam
        readings.append(LabelledPoints(points_m - shift_m, is_tumour(points_m)))
        beams.append(beam)
        shifts_m.append(shift_m)
    return readings, np.array(beams), np.array(shifts_m)


def observed(readings, beams) -> ReadingShifts:
    shifts = ReadingShifts(DEVIATION_M)
    for n in range(1, len(readings) + 1):
        shifts.observe(readings[:n], beams[:n])
    return shifts


def off_m(shifts_m) -> float:
    return float(np.sqrt((shifts_m**2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", range(4))
def test_planted_shifts_are_found(seed) -> None:
    readings, beams, true_m = measured(np.random.default_rng(seed), 12)
    shifts = observed(readings, beams)
    left_m = shifts.shifts_m - true_m
    assert off_m(left_m - left_m.mean(axis=0)) < 0.4 * off_m(true_m - true_m.mean(axis=0))
    # Nothing tells where all of them lie together, but that their shifts are small.
    assert off_m(left_m) < 0.6 * off_m(true_m)


def test_it_says_how_far_readings_are_still_off() -> None:
    runs = [measured(np.random.default_rng(seed), 10) for seed in range(10, 15)]
    left, told = [], []
    for readings, beams, true_m in runs:
        shifts = observed(readings, beams)
        left.append(off_m(shifts.shifts_m - true_m))
        told.append(shifts.deviation_m)
    assert 0.6 < np.mean(told) / np.mean(left) < 1.6
    assert observed(runs[0][0][:1], runs[0][1][:1]).deviation_m == 0.0


def test_what_sees_no_tumour_stays_where_it_is() -> None:
    rng = np.random.default_rng(1)
    readings, beams, _ = measured(rng, 5, is_tumour=lambda points_m: np.zeros(len(points_m), dtype=bool))
    assert not observed(readings, beams).shifts_m.any()
    assert not observed(*measured(rng, 1)[:2]).shifts_m.any()
    empty = LabelledPoints(np.empty((0, 3)), np.empty(0, dtype=bool))
    told, beams, _ = measured(rng, 3)
    with_none = observed([told[0], empty, *told[1:]], beams[[0, 0, 1, 2]]).shifts_m
    assert not with_none[1].any()
    assert with_none[[0, 2, 3]].any(axis=1).all()


def test_readings_of_another_tumour_far_off_change_nothing() -> None:
    readings, beams, _ = measured(np.random.default_rng(2), 4)
    others, other_beams, _ = measured(np.random.default_rng(3), 1)
    far = others[0].at(others[0].points_m + np.array([0.2, 0.0, 0.0]))
    alone = observed(readings, beams).shifts_m
    both = observed([*readings, far], np.concatenate([beams, other_beams])).shifts_m
    # The one far off gives all of them another turn, and is itself left alone.
    assert np.abs(both[-1]).max() < 1e-12
    assert np.abs(both[:4] - alone).max() < 0.001


def test_the_frame_does_not_matter() -> None:
    readings, beams, _ = measured(np.random.default_rng(4), 8)
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5])
    turned = [each.at(turn.apply(each.points_m)) for each in readings]
    there = observed(turned, turn.apply(beams)).shifts_m
    # Lattice and grid of shifts are others there.
    assert off_m(there - turn.apply(observed(readings, beams).shifts_m)) < 0.001


def test_readings_move_together_to_where_they_are_likeliest() -> None:
    readings, beams, _ = measured(np.random.default_rng(5), 9)
    shifts_m = observed(readings, beams).shifts_m

    def squares(c_m) -> float:
        moved_m = shifts_m + 1e-3 * c_m
        along_m = (moved_m * beams).sum(axis=1)
        across2 = (moved_m**2).sum(axis=1) - along_m**2
        return float((across2 / DEVIATION_M**2 + (along_m / reading_shifts.ALONG_M) ** 2).sum())

    best = minimize(squares, np.full(3, 0.5))
    assert np.abs(best.x).max() < 1e-3


def test_labels_that_may_be_wrong_count_for_less() -> None:
    readings, beams, true_m = measured(np.random.default_rng(6), 8)

    def believed_by(log_odds: float) -> list[LabelledPoints]:
        told = [log_odds * np.where(each.is_occupied, 1.0, -1.0) for each in readings]
        return [
            LabelledPoints(each.points_m, each.is_occupied, log_odds=values)
            for each, values in zip(readings, told, strict=True)
        ]

    exact = observed(readings, beams)
    assert np.allclose(observed(believed_by(50.0), beams).shifts_m, exact.shifts_m)
    # Labels that are hardly likelier than not are believed nowhere, and against themselves they say nothing.
    assert not observed(believed_by(1e-3), beams).shifts_m.any()
    assert not observed(believed_by(-50.0), beams).shifts_m.any()
    light = observed(
        [LabelledPoints(e.points_m, e.is_occupied, weight=np.full(800, 1e-4)) for e in readings], beams
    )
    assert off_m(light.shifts_m) < 0.01 * off_m(true_m)
    assert light.deviation_m > exact.deviation_m


def test_slips_of_the_reader_move_little_where_no_tumour_is() -> None:
    rng = np.random.default_rng(7)
    readings, beams, _ = measured(rng, 8, is_tumour=lambda points_m: rng.random(len(points_m)) < 0.02)
    log_odds = np.log(0.98 / 0.02)
    told = [
        LabelledPoints(e.points_m, e.is_occupied, log_odds=np.where(e.is_occupied, log_odds, -log_odds))
        for e in readings
    ]
    # Chance alone makes some neighbours slip together now and then.
    assert off_m(observed(told, beams).shifts_m) < 0.1 * DEVIATION_M


def test_each_tumours_readings_move_together_by_themselves() -> None:
    readings, beams, _ = measured(np.random.default_rng(8), 5)
    others, other_beams, _ = measured(np.random.default_rng(9), 5)
    far = [each.at(each.points_m + np.array([0.08, 0.0, 0.0])) for each in others]
    shifts_m = observed([*readings, *far], np.concatenate([beams, other_beams])).shifts_m
    for part, some_beams in ((shifts_m[:5], beams), (shifts_m[5:], other_beams)):
        along = np.einsum("ni,nj->nij", some_beams, some_beams)
        precisions = (np.eye(3) - along) / DEVIATION_M**2 + along / reading_shifts.ALONG_M**2
        assert np.abs(np.einsum("nij,nj->i", precisions, part)).max() < 1e-9 / DEVIATION_M**2


@pytest.mark.parametrize("deviation_m", [0.0001, 0.0006, 0.02])
def test_any_size_of_error_has_a_grid_of_shifts(deviation_m) -> None:
    readings, beams, _ = measured(np.random.default_rng(10), 4)
    shifts = ReadingShifts(deviation_m)
    for n in range(1, 5):
        shifts.observe(readings[:n], beams[:n])
    assert np.isfinite(shifts.shifts_m).all()
    # Small errors are finer than labels tell, and of large ones the labels tell much.
    assert 0.3 * min(deviation_m, 0.003) < shifts.deviation_m < 1.5 * deviation_m

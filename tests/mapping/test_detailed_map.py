"""Detailed maps: small tumours kept, what was sensed never denied, doubt far away, and probabilities that hold."""

from dataclasses import replace

import numpy as np
import pytest
from detailed_maps import make_coarse, make_detailed, readings
from scipy.stats import binomtest

from mapping import (
    DetailedMap,
    DetailSettings,
    HilbertMap,
    LabelledPoints,
    Lattice,
    MapSettings,
    average_precision,
)

LOW_M, HIGH_M = (-0.06, -0.06, -0.08), (0.06, 0.06, 0.0)
CENTRE_M, RADIUS_M = np.array([0.004, -0.003, -0.04]), 0.006


def make_large(**changes):
    settings = MapSettings(**changes)
    hinges = Lattice.from_box(LOW_M, HIGH_M, spacing_m=settings.hinge_spacing_m)
    query = Lattice.from_box(LOW_M, HIGH_M, spacing_m=0.004)
    return HilbertMap(hinges, settings, query=query)


def make_large_detailed(detail=None):
    return DetailedMap(make_large(), detail)


def test_before_any_reading_it_expects_the_prevalence_everywhere():
    prediction = make_detailed(prior_prevalence=0.03).predict_lattice()
    np.testing.assert_allclose(prediction.probability, 0.03, rtol=1e-9)


def test_without_tumour_sensed_it_is_the_coarse_map_with_a_doubt_that_grows_with_the_distance():
    settings = DetailSettings(cube_m=1e-6)
    coarse, detailed = make_coarse(), make_detailed(detail=settings)
    points_m = np.random.default_rng(0).uniform((-0.03, -0.03, -0.04), (-0.01, 0.03, 0.0), (300, 3))
    for each in (coarse, detailed):
        each.update(points_m, np.zeros(300, dtype=bool))
    asked_m = coarse.query_points_m()
    distance_m = np.linalg.norm(asked_m[:, None] - points_m, axis=2).min(axis=1)
    share = settings.doubt * (1 - np.exp(-((distance_m / settings.doubt_m) ** 2)))
    expected = (1 - share) * coarse.predict_lattice().probability + share * 0.02
    # Beyond three times `doubt_m` the share counts as full.
    np.testing.assert_allclose(detailed.predict_lattice().probability, expected, rtol=2e-4, atol=1e-9)


def test_a_small_tumour_that_the_coarse_map_smooths_away_is_kept():
    rng = np.random.default_rng(2)
    coarse, detailed = make_large(), DetailedMap(make_large())
    for _ in range(4):
        points_m = CENTRE_M + rng.uniform(-0.025, 0.025, (600, 3))
        labels = np.linalg.norm(points_m - CENTRE_M, axis=1) < RADIUS_M
        coarse.update(points_m, labels)
        detailed.update(points_m, labels)
    is_tumour = np.linalg.norm(detailed.query_points_m() - CENTRE_M, axis=1) < RADIUS_M
    smooth, sharp = coarse.predict_lattice(), detailed.predict_lattice()
    assert smooth.probability[is_tumour].mean() < 0.4 < 0.6 < sharp.probability[is_tumour].mean()
    assert average_precision(sharp.score, is_tumour) > average_precision(smooth.score, is_tumour) + 0.05


@pytest.mark.parametrize("offset_m", [0.0, 0.0009, 0.0019])
def test_a_single_label_of_tumour_among_many_that_are_free_is_called_tumour(offset_m):
    detailed, rng = make_detailed(), np.random.default_rng(3)
    asked_m = detailed.query_points_m()
    place = int(np.argmin(np.linalg.norm(asked_m - (0.0, 0.0, -0.02), axis=1)))
    points_m = rng.uniform((-0.03, -0.03, -0.04), (0.03, 0.03, 0.0), (600, 3))
    points_m = points_m[np.linalg.norm(points_m - asked_m[place], axis=1) > 0.004]
    label_m = asked_m[place] + offset_m / np.sqrt(3)
    detailed.update(np.vstack([points_m, label_m]), np.arange(len(points_m) + 1) == len(points_m))
    probability = detailed.predict_lattice().probability
    assert probability[place] > 0.5
    assert (probability > 0.5).sum() == 1


def test_at_the_rim_of_a_tumour_that_is_called_a_single_label_changes_no_probability():
    rng, radius_m = np.random.default_rng(4), 0.014
    detailed = make_large_detailed()
    for _ in range(4):
        points_m = CENTRE_M + rng.uniform(-0.025, 0.025, (900, 3))
        detailed.update(points_m, np.linalg.norm(points_m - CENTRE_M, axis=1) < radius_m)
    lattice, anywhere = detailed.predict_lattice(), detailed.predict(detailed.query_points_m())
    assert (lattice.score > 0).sum() > 100
    # Summing the variance on the lattice in single precision leaves 2e-5; a call would move a score by far more.
    np.testing.assert_allclose(lattice.score, anywhere.score, atol=1e-4)


def test_a_label_of_tumour_farther_from_a_place_than_a_free_one_does_not_decide_about_it():
    detailed = make_detailed()
    place_m = detailed.query_points_m()[100]
    near_m, farther_m = place_m + np.array([0.0005, 0.0, 0.0]), place_m - np.array([0.0025, 0.0, 0.0])
    around_m = place_m + np.random.default_rng(0).uniform(-0.02, 0.02, (500, 3))
    around_m = around_m[np.linalg.norm(around_m - place_m, axis=1) > 0.004]
    detailed.update(np.vstack([near_m, farther_m, around_m]), np.arange(len(around_m) + 2) == 1)
    assert detailed.predict_lattice().probability[100] < 0.5


def test_at_the_points_of_the_lattice_both_answers_agree_save_where_tumour_was_sensed():
    detailed = make_detailed()
    for reading in readings(3):
        detailed.update(*reading)
    on_lattice, anywhere = detailed.predict_lattice(), detailed.predict(detailed.query_points_m())
    # Single precision leaves 1e-5; a finding moves a score by far more.
    differs = np.abs(on_lattice.score - anywhere.score) > 1e-4
    tumour_m = np.concatenate([points_m[labels] for points_m, labels in readings(3)])
    gaps_m = np.linalg.norm(detailed.query_points_m()[:, None] - tumour_m, axis=2).min(axis=1)
    # The farthest that a label can be from the point that is nearest to it is half a diagonal of 6 mm cells.
    assert not differs[gaps_m > 0.0052].any()
    assert np.all(on_lattice.score[differs] > anywhere.score[differs])
    np.testing.assert_allclose(on_lattice.latent_variance, anywhere.latent_variance, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("settings", [DetailSettings(), DetailSettings.of_many_labels()])
def test_readings_asked_about_one_by_one_and_all_at_the_end_give_the_same_bytes(settings):
    asked_often, asked_once = make_detailed(detail=settings), make_detailed(detail=settings)
    for reading in readings(8):
        for each in (asked_often, asked_once):
            each.update(*reading)
        asked_often.predict_lattice()
    np.testing.assert_array_equal(asked_often.predict_lattice().score, asked_once.predict_lattice().score)


def test_its_probabilities_hold_on_planted_tumours():
    """Of places in doubt, those called p are tumour about as often: over 40 planted worlds, in three bins."""
    rng = np.random.default_rng(7)
    said, true = [], []
    for _ in range(40):
        detailed = make_detailed()
        centre_m, radius_m = (
            rng.uniform((-0.02, -0.02, -0.03), (0.02, 0.02, -0.01)),
            rng.uniform(0.005, 0.012),
        )
        for _ in range(3):
            middle_m = centre_m + rng.uniform(-0.012, 0.012, 3)
            points_m = middle_m + rng.uniform(-0.01, 0.01, (120, 3))
            detailed.update(points_m, np.linalg.norm(points_m - centre_m, axis=1) < radius_m)
        said.append(detailed.predict_lattice().probability)
        true.append(np.linalg.norm(detailed.query_points_m() - centre_m, axis=1) < radius_m)
    probability, is_tumour = np.concatenate(said), np.concatenate(true)
    for low, high in ((0.1, 0.35), (0.35, 0.65), (0.65, 0.9)):
        some = (probability > low) & (probability < high)
        assert some.sum() > 80
        # Points of one world hang together, so that the interval of independent ones is doubled.
        interval = binomtest(int(is_tumour[some].sum()), int(some.sum())).proportion_ci(0.99)
        middle, half = (interval.low + interval.high) / 2, interval.high - interval.low
        assert abs(probability[some].mean() - middle) < half + 0.05, (low, middle, probability[some].mean())


def test_it_can_be_revised_and_keeps_a_diagonal_covariance():
    detailed, diagonal = make_detailed(), make_detailed(form="diagonal")
    for reading in readings(3):
        detailed.update(*reading)
        diagonal.update(*reading)
    assert detailed.revise() > 0.0
    assert np.isfinite(diagonal.predict_lattice().score).all()
    assert len(detailed.predict(np.empty((0, 3))).score) == 0


def test_scattered_false_labels_change_nothing_near_them_where_the_sensor_is_known_to_make_them():
    rng = np.random.default_rng(5)
    points_m = rng.uniform((-0.03, -0.03, -0.04), (0.03, 0.03, 0.0), (800, 3))
    labels = rng.random(800) < 0.02
    knowing = make_detailed(false_positive_rate=0.02)
    knowing.update(points_m, labels)
    assert (knowing.predict_lattice().probability > 0.5).sum() <= 1
    trusting = make_detailed()
    trusting.update(points_m, labels)
    assert (trusting.predict_lattice().probability > 0.5).sum() >= 8


def test_a_doubt_of_zero_leaves_the_coarse_map_alone_where_no_tumour_is_near():
    coarse, detailed = make_coarse(), make_detailed(detail=DetailSettings(doubt=0.0))
    for reading in readings(3):
        coarse.update(*reading)
        detailed.update(*reading)
    tumour_m = np.concatenate([points_m[labels] for points_m, labels in readings(3)])
    gaps_m = np.linalg.norm(coarse.query_points_m()[:, None] - tumour_m, axis=2).min(axis=1)
    far = gaps_m > DetailSettings().reach_m
    assert 100 < far.sum() < len(far) - 20
    np.testing.assert_array_equal(detailed.predict_lattice().score[far], coarse.predict_lattice().score[far])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"length_m": 0.0}, "`length_m` must be positive"),
        ({"reach_m": np.nan}, "`reach_m` must be positive"),
        ({"prior_mean": np.inf}, "`prior_mean` must be finite"),
        ({"n_neighbours": 0}, "`n_neighbours` must be a whole number"),
        ({"doubt": 1.0}, "`doubt` must lie"),
    ],
)
def test_settings_out_of_range_are_refused(change, text):
    with pytest.raises(ValueError, match=text):
        DetailSettings(**change)


def some_readings(n, *, seed=5):
    """Readings about a tumour, each from elsewhere."""
    rng, made = np.random.default_rng(seed), []
    for _ in range(n):
        points_m = CENTRE_M + rng.uniform(-0.012, 0.012, 3) + rng.uniform(-0.025, 0.025, (400, 3))
        made.append(LabelledPoints(points_m, np.linalg.norm(points_m - CENTRE_M, axis=1) < RADIUS_M))
    return made


def test_places_of_one_cell_are_near_those_that_ask_their_own_labels():
    own = DetailSettings()
    apart, together = make_large_detailed(own), make_large_detailed(replace(own, cell_m=0.0045))
    for reading in some_readings(6):
        for each in (apart, together):
            each.update(reading.points_m, reading.is_occupied)
    one, other = apart.predict_lattice().probability, together.predict_lattice().probability
    # A place is at most 3.9 mm from its cube's centre, a third of the kernel's length: rims move a little.
    is_mixed = (one > 0.02) & (one < 0.98)
    assert is_mixed.sum() > 100
    assert np.abs(one - other)[is_mixed].mean() < 0.1
    assert np.mean((one > 0.5) == (other > 0.5)) > 0.99


def test_readings_laid_at_once_make_the_map_that_they_make_one_after_the_other():
    one_by_one, at_once = make_large_detailed(), make_large_detailed()
    for reading in some_readings(6):
        one_by_one.update(reading.points_m, reading.is_occupied)
    at_once.lay_labels(some_readings(6))
    for one, other in zip(one_by_one.state().items(), at_once.state().items(), strict=True):
        assert one[0] == other[0]
        np.testing.assert_array_equal(one[1], other[1])
    mine, yours = one_by_one.predict_lattice(), at_once.predict_lattice()
    np.testing.assert_array_equal(mine.score, yours.score)
    np.testing.assert_array_equal(mine.latent_variance, yours.latent_variance)
    # And what comes after them makes the same of both.
    more = some_readings(2, seed=6)
    for each in more:
        for detailed in (one_by_one, at_once):
            detailed.update(each.points_m, each.is_occupied)
    np.testing.assert_array_equal(one_by_one.predict_lattice().score, at_once.predict_lattice().score)


def test_labels_that_are_moved_decide_near_tumour_where_they_lie_now():
    shift_m, detailed, still = np.array([0.0015, 0.0, 0.0]), make_large_detailed(), make_large_detailed()
    before = some_readings(6)
    for reading in before[:5]:
        detailed.update(reading.points_m, reading.is_occupied)
    for reading in before:
        still.update(reading.points_m, reading.is_occupied)
    # The last reading is new, and the coarse map learns it where it lies.
    now = [*(each.at(each.points_m + shift_m) for each in before[:5]), before[5]]
    detailed.lay_labels(now)
    np.testing.assert_array_equal(detailed.coarse.belief.mean, still.coarse.belief.mean)
    anew = make_large_detailed()
    anew.lay_labels(now)
    near = np.linalg.norm(detailed.query_points_m() - CENTRE_M - shift_m, axis=1) < 2.0 * RADIUS_M
    moved, fresh, old = (each.predict_lattice().score[near] for each in (detailed, anew, still))
    # A coarse map that is 1.5 mm off changes little there; labels that are as far off change much.
    assert np.abs(moved - fresh).max() < 0.3 * np.abs(old - fresh).max()


def test_causes_that_make_rims_less_sure_add_up():
    plain = DetailSettings()
    assert plain.where_views_are_off(0.0) == plain

    def doubt(*off):
        return (plain.sharpness / plain.where_views_are_off(*off).sharpness) ** 2 - 1.0

    assert doubt(0.003, 1.0) == pytest.approx(doubt(0.003) + doubt(0.0, 1.0))
    assert doubt(0.0, 3.0) == pytest.approx(9.0 * doubt(0.0, 1.0))
    counted = plain.where_views_are_off(0.003, 1.0, counts_views=True).sharpness
    assert plain.where_views_are_off(0.003, 1.0).sharpness < counted < plain.sharpness
    assert 0.0 < doubt(0.0005) < doubt(0.001) < doubt(0.003)

"""Finer maps laid into a map: boxes around clusters, each with a map of its own, small tumours kept."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mapping import DetailedMap, HilbertMap, InsetSettings, Lattice, MapSettings, average_precision
from mapping.boxes import boxes_around

LOW_M, HIGH_M = (-0.06, -0.06, -0.08), (0.06, 0.06, 0.0)
CENTRE_M, RADIUS_M = np.array([0.004, -0.003, -0.04]), 0.006
QUERY = Lattice.from_box(LOW_M, HIGH_M, spacing_m=0.004)
INSIDE = np.abs(QUERY.points_m()[:, 0]) < 0.05


def make_coarse(**changes):
    settings = MapSettings(**changes)
    hinges = Lattice.from_box(LOW_M, HIGH_M, spacing_m=settings.hinge_spacing_m)
    return HilbertMap(hinges, settings, query=QUERY, query_mask=INSIDE)


def reading(rng, *, n_points=1000, centre_m=CENTRE_M):
    points_m = rng.uniform(LOW_M, HIGH_M, (n_points, 3))
    return points_m, np.linalg.norm(points_m - centre_m, axis=1) < RADIUS_M


@given(arrays(float, (12, 3), elements=st.floats(-0.2, 0.2)), st.floats(0.001, 0.03), st.floats(0.002, 0.02))
def test_every_point_lies_in_a_box_with_the_margin_and_no_box_reaches_much_farther(
    points_m, margin_m, step_m
):
    boxes = boxes_around(points_m, margin_m=margin_m, step_m=step_m)
    assert 1 <= len(boxes) <= len(points_m)
    for point in points_m:
        gaps_m = [min((point - box.low_m).min(), (box.high_m - point).min()) for box in boxes]
        assert max(gaps_m) >= margin_m - 1e-12
    for box in boxes:
        inside_m = points_m[box.holds(points_m, -margin_m + 1e-9)]
        assert np.all(inside_m.min(axis=0) - box.low_m <= margin_m + step_m + 1e-9)
        assert np.all(box.high_m - inside_m.max(axis=0) <= margin_m + step_m + 1e-9)
    order = np.random.default_rng(0).permutation(len(points_m))
    again = boxes_around(points_m[order], margin_m=margin_m, step_m=step_m)
    assert set(again) == set(boxes)


def test_without_tumour_sensed_it_is_the_coarse_map_to_the_bit():
    coarse, detailed = make_coarse(), DetailedMap(make_coarse())
    rng = np.random.default_rng(0)
    for _ in range(3):
        points_m = rng.uniform(LOW_M, HIGH_M, (300, 3))
        coarse.update(points_m, np.zeros(300, dtype=bool))
        detailed.update(points_m, np.zeros(300, dtype=bool))
    assert detailed.boxes == []
    np.testing.assert_array_equal(detailed.predict_lattice().score, coarse.predict_lattice().score)
    np.testing.assert_array_equal(
        detailed.predict(points_m).latent_mean, coarse.predict(points_m).latent_mean
    )


def test_inside_its_box_it_is_the_fine_map_of_the_same_readings_and_outside_the_coarse_one():
    rng, settings = np.random.default_rng(1), InsetSettings(tolerance=0.0)
    readings = [reading(rng, n_points=300) for _ in range(3)]
    coarse, detailed = make_coarse(tolerance=0.0), DetailedMap(make_coarse(tolerance=0.0), settings)
    spacing_m = settings.hinge_spacing_m
    box, fine = None, coarse
    for number, (points_m, labels) in enumerate(readings, start=1):
        coarse.update(points_m, labels)
        detailed.update(points_m, labels)
        is_laid_in_anew = detailed.boxes != [box]
        (box,) = detailed.boxes
        if is_laid_in_anew:
            fine = HilbertMap(
                Lattice.from_box(box.low_m - spacing_m, box.high_m + spacing_m, spacing_m=spacing_m),
                replace(
                    coarse.settings, hinge_spacing_m=spacing_m, gamma_per_m2=4 * coarse.settings.gamma_per_m2
                ),
            )
        for points_m, labels in readings[0 if is_laid_in_anew else number - 1 : number]:
            near = box.holds(points_m, spacing_m)
            fine.update(points_m[near], labels[near])
        if is_laid_in_anew:
            fine.revise()
    asked_m = detailed.query_points_m()
    inside = box.holds(asked_m)
    assert 100 < inside.sum() < len(asked_m) / 2
    on_lattice, anywhere = detailed.predict_lattice(), detailed.predict(asked_m)
    expected = np.where(inside, fine.predict(asked_m).latent_mean, coarse.predict_lattice().latent_mean)
    np.testing.assert_allclose(on_lattice.latent_mean, expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(anywhere.latent_mean, expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(anywhere.latent_variance, on_lattice.latent_variance, rtol=1e-6, atol=1e-6)


def test_a_small_tumour_that_the_coarse_map_smooths_away_is_kept():
    rng = np.random.default_rng(2)
    coarse, detailed = make_coarse(), DetailedMap(make_coarse())
    for _ in range(4):
        points_m = CENTRE_M + rng.uniform(-0.025, 0.025, (600, 3))
        labels = np.linalg.norm(points_m - CENTRE_M, axis=1) < RADIUS_M
        coarse.update(points_m, labels)
        detailed.update(points_m, labels)
    is_tumour = np.linalg.norm(detailed.query_points_m() - CENTRE_M, axis=1) < RADIUS_M
    smooth, sharp = coarse.predict_lattice(), detailed.predict_lattice()
    assert smooth.probability[is_tumour].mean() < 0.4 < 0.6 < sharp.probability[is_tumour].mean()
    assert average_precision(sharp.score, is_tumour) > average_precision(smooth.score, is_tumour) + 0.05


def test_a_diagonal_covariance_is_carried_into_the_box():
    detailed = DetailedMap(make_coarse(form="diagonal"))
    detailed.update(*reading(np.random.default_rng(4)))
    assert len(detailed.boxes) == 1
    assert np.isfinite(detailed.predict_lattice().score).all()


def test_two_tumours_get_a_box_each_and_one_box_when_labels_join_them():
    detailed, rng = DetailedMap(make_coarse()), np.random.default_rng(3)
    ends = [np.array([-0.03, 0.0, -0.04]), np.array([0.03, 0.0, -0.04])]
    for centre_m in ends:
        detailed.update(*reading(rng, centre_m=centre_m))
    assert len(detailed.boxes) == 2
    assert detailed.n_weights > detailed.coarse.n_weights
    bridge_m = np.linspace(*ends, 30)
    detailed.update(bridge_m, np.ones(30, dtype=bool))
    assert len(detailed.boxes) == 1


@pytest.mark.parametrize("max_hinges", [1, 50])
def test_a_box_too_large_for_finer_hinges_is_left_to_the_coarse_map(max_hinges):
    detailed = DetailedMap(make_coarse(), InsetSettings(max_hinges=max_hinges))
    detailed.update(*reading(np.random.default_rng(4)))
    assert detailed.boxes == []
    assert detailed.n_weights == detailed.coarse.n_weights


def test_scattered_false_labels_lay_in_nothing_where_the_sensor_is_known_to_make_them():
    detailed = DetailedMap(make_coarse(false_positive_rate=0.02))
    rng = np.random.default_rng(5)
    points_m = rng.uniform(LOW_M, HIGH_M, (1000, 3))
    detailed.update(points_m, rng.random(1000) < 0.02)
    assert len(detailed.boxes) <= 1  # one in a thousand labels passes by chance


def test_revising_reaches_the_finer_maps_too():
    detailed, rng = DetailedMap(make_coarse()), np.random.default_rng(6)
    for _ in range(3):
        detailed.update(*reading(rng, n_points=200))
    before = detailed.predict_lattice().score
    assert detailed.revise() > 0.0
    changed = np.abs(detailed.predict_lattice().score - before)
    inside = detailed.boxes[0].holds(detailed.query_points_m())
    assert changed[inside].max() > 1e-3


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"hinge_spacing_m": 0.0}, "`hinge_spacing_m` must be positive"),
        ({"margin_m": np.nan}, "`margin_m` must be positive"),
        ({"tolerance": 1.0}, "`tolerance` must lie"),
        ({"max_hinges": 0}, "`max_hinges` must be"),
    ],
)
def test_settings_out_of_range_are_refused(change, text):
    with pytest.raises(ValueError, match=text):
        InsetSettings(**change)

"""The belief against an independent dense computation, and the laws that Bayes' rule must keep."""

import numpy as np
import pytest
from dense_reference import CholeskyReference, DenseDiagonal, DenseReference

from mapping import HilbertMap, Lattice, MapSettings

SPACING_M = 0.01125
BOX_M = ((-0.04, -0.04, -0.06), (0.04, 0.04, 0.0))


def cone_points(rng, apex_m, n, half_angle_rad=0.2007, depth_m=0.06):
    """Points even in volume in a cone that looks down from its apex."""
    depth = depth_m * rng.random(n) ** (1 / 3)
    radius = depth * np.tan(half_angle_rad) * np.sqrt(rng.random(n))
    angle = 2 * np.pi * rng.random(n)
    return np.asarray(apex_m) + np.stack([radius * np.cos(angle), radius * np.sin(angle), -depth], axis=1)


def readings(n_readings, n_points=150, seed=0):
    """Cones over the box, with labels from a sphere of 12 mm at its middle."""
    rng = np.random.default_rng(seed)
    for _ in range(n_readings):
        points_m = cone_points(rng, (*rng.uniform(-0.03, 0.03, 2), 0.0), n_points)
        yield points_m, np.linalg.norm(points_m - (0.0, 0.0, -0.035), axis=1) < 0.012


def make_map(**changes):
    settings = MapSettings(**changes)
    hinges = Lattice.from_box(*BOX_M, spacing_m=settings.hinge_spacing_m)
    return HilbertMap(hinges, settings, query=Lattice.from_box(*BOX_M, spacing_m=0.007))


def make_reference(hilbert_map, kind=DenseReference):
    settings = hilbert_map.settings
    return kind(
        hilbert_map.hinges.points_m(),
        gamma_per_m2=settings.gamma_per_m2,
        weight_variance=settings.weight_variance,
        prevalence=settings.prior_prevalence,
        n_iterations=settings.n_em_iterations,
    )


@pytest.mark.parametrize("prior_prevalence", [0.5, 0.05])
def test_exact_posterior_equals_dense_bayes_after_five_readings(prior_prevalence):
    exact = make_map(tolerance=0.0, prior_prevalence=prior_prevalence)
    reference = make_reference(exact)
    for points_m, is_occupied in readings(5):
        exact.update(points_m, is_occupied)
        reference.update(points_m, is_occupied)
    mean, variance, probability = reference.predict(exact.query_points_m())
    answer = exact.predict_lattice()
    # 1e-6 relative is what the exact path promises; the precision form itself rounds at about 1e-9.
    np.testing.assert_allclose(answer.latent_mean, mean, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(answer.latent_variance, variance, rtol=1e-6)
    np.testing.assert_allclose(answer.probability, probability, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(exact.belief.covariance.matrix, reference.covariance, atol=1e-6)


def test_the_benchmarks_dense_form_is_the_oracle_by_another_factor():
    oracle, tidy = (make_reference(make_map(), kind) for kind in (DenseReference, CholeskyReference))
    for points_m, is_occupied in readings(3):
        oracle.update(points_m, is_occupied)
        tidy.update(points_m, is_occupied)
    points_m = make_map().query_points_m()
    np.testing.assert_allclose(tidy.predict(points_m), oracle.predict(points_m), rtol=1e-8, atol=1e-8)


def test_default_compression_moves_no_probability_by_more_than_a_thousandth():
    default = make_map()
    reference = make_reference(default)
    for points_m, is_occupied in readings(12):
        default.update(points_m, is_occupied)
        reference.update(points_m, is_occupied)
    _, _, probability = reference.predict(default.query_points_m())
    assert np.abs(default.predict_lattice().probability - probability).max() < 1e-3


def test_a_smaller_tolerance_comes_closer():
    errors = []
    reference = make_reference(make_map())
    for points_m, is_occupied in readings(6):
        reference.update(points_m, is_occupied)
    _, _, probability = reference.predict(make_map().query_points_m())
    for tolerance in (1e-4, 1e-6, 1e-8):
        tumour_map = make_map(tolerance=tolerance)
        for points_m, is_occupied in readings(6):
            tumour_map.update(points_m, is_occupied)
        errors.append(np.abs(tumour_map.predict_lattice().probability - probability).max())
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


def test_diagonal_form_equals_its_dense_form():
    diagonal = make_map(form="diagonal", tolerance=0.0)
    reference = make_reference(diagonal, DenseDiagonal)
    for points_m, is_occupied in readings(4):
        diagonal.update(points_m, is_occupied)
        reference.update(points_m, is_occupied)
    mean, variance, _ = reference.predict(diagonal.query_points_m())
    np.testing.assert_allclose(diagonal.predict_lattice().latent_mean, mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(diagonal.predict_lattice().latent_variance, variance, rtol=1e-9)


@pytest.mark.parametrize("form", ["full", "diagonal"])
def test_any_point_is_predicted_as_the_lattice_is(form):
    tumour_map = make_map(form=form)
    for points_m, is_occupied in readings(4):
        tumour_map.update(points_m, is_occupied)
    anywhere, carried = tumour_map.predict(tumour_map.query_points_m()), tumour_map.predict_lattice()
    # Both leave out what lies below the tolerance of 1e-6, the one per query and the other per reading.
    np.testing.assert_allclose(anywhere.probability, carried.probability, atol=3e-4)
    np.testing.assert_allclose(anywhere.latent_variance, carried.latent_variance, atol=1e-3)


@pytest.mark.parametrize("prevalence", [0.5, 0.05, 0.001])
def test_without_data_every_point_has_the_prior_prevalence(prevalence):
    tumour_map = make_map(prior_prevalence=prevalence)
    np.testing.assert_allclose(tumour_map.predict_lattice().probability, prevalence, rtol=1e-12)


def test_far_from_data_the_prior_returns():
    tumour_map = make_map()
    rng = np.random.default_rng(0)
    tumour_map.update(rng.uniform((-0.04, -0.04, -0.06), (-0.03, 0.04, 0.0), (200, 3)), np.zeros(200))
    far_m = np.array([[0.04, 0.0, -0.03], [0.035, 0.03, 0.0]])
    # Six spacings away the kernel is 1e-11, but the weights between pass a little on.
    np.testing.assert_allclose(tumour_map.predict(far_m).probability, 0.02, rtol=5e-3)


def test_a_reading_in_one_piece_or_by_halves_says_nearly_the_same():
    whole, halves = (make_map(weight_variance=4.0, gamma_per_m2=5 / 0.03**2) for _ in range(2))
    points_m, is_occupied = next(iter(readings(1, n_points=300)))
    whole.update(points_m, is_occupied)
    halves.update(points_m[::2], is_occupied[::2])
    halves.update(points_m[1::2], is_occupied[1::2])
    difference = np.abs(whole.predict_lattice().probability - halves.predict_lattice().probability)
    # Not equal, since the bound is centred anew for each reading.
    assert 0 < difference.max() < 0.1


def test_an_empty_reading_changes_nothing():
    tumour_map = make_map()
    before = tumour_map.predict_lattice().latent_mean
    report = tumour_map.update(np.zeros((0, 3)), np.zeros(0))
    assert report.n_points == 0
    np.testing.assert_array_equal(tumour_map.predict_lattice().latent_mean, before)


def test_one_occupied_point_raises_and_one_free_point_lowers_its_probability():
    point_m = np.array([[0.0, 0.0, -0.03]])
    for label, sign in ((1, 1), (0, -1)):
        tumour_map = make_map()
        before = tumour_map.predict(point_m)
        tumour_map.update(point_m, [label])
        after = tumour_map.predict(point_m)
        assert sign * (after.latent_mean - before.latent_mean)[0] > 0
        assert after.latent_variance[0] < before.latent_variance[0]


def test_hinges_out_of_reach_may_be_dropped():
    kept, masked = make_map(), None
    hinges = kept.hinges
    near = hinges.points_m()[:, 0] < 0.025
    query = Lattice.from_box((-0.04, -0.04, -0.06), (-0.02, 0.04, 0.0), spacing_m=0.007)
    kept = HilbertMap(hinges, query=query)
    masked = HilbertMap(hinges, query=query, hinge_mask=near)
    rng = np.random.default_rng(3)
    points_m = rng.uniform((-0.04, -0.04, -0.06), (-0.025, 0.04, 0.0), (200, 3))
    is_occupied = points_m[:, 2] < -0.03
    for tumour_map in (kept, masked):
        tumour_map.update(points_m, is_occupied)
    assert masked.n_weights == near.sum() < kept.n_weights
    # The dropped hinges lie 4 spacings or more from the data: features below 2e-5.
    np.testing.assert_allclose(
        kept.predict_lattice().probability, masked.predict_lattice().probability, atol=1e-3
    )


@pytest.mark.parametrize(
    ("points_m", "labels", "complaint"),
    [
        (np.zeros((3, 2)), np.zeros(3), r"shape \(N, 3\)"),
        (np.full((2, 3), np.nan), np.zeros(2), "finite"),
        (np.zeros((3, 3)), np.zeros(2), "one label for each of 3"),
        (np.zeros((2, 3)), np.array([0.5, 1]), "only False and True"),
    ],
)
def test_a_malformed_reading_is_refused_and_leaves_the_map_alone(points_m, labels, complaint):
    tumour_map = make_map()
    with pytest.raises(ValueError, match=complaint):
        tumour_map.update(points_m, labels)
    np.testing.assert_allclose(tumour_map.predict_lattice().probability, 0.02, rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"prior_prevalence": 0.0}, "prior_prevalence"),
        ({"weight_variance": -1.0}, "weight_variance"),
        ({"n_em_iterations": 0}, "n_em_iterations"),
        ({"form": "dense"}, "form"),
        ({"tolerance": 1.0}, "tolerance"),
        ({"gamma_per_m2": np.inf}, "gamma_per_m2"),
    ],
)
def test_settings_out_of_range_are_refused(changes, complaint):
    with pytest.raises(ValueError, match=complaint):
        MapSettings(**changes)

"""The covariance kept near its diagonal against the whole one, and the variance's two other forms."""

import numpy as np
import pytest

from mapping import HilbertMap, Lattice, MapSettings
from mapping.belief.carried_variance import CarriedVariance
from mapping.belief.dense_covariance import DenseCovariance
from mapping.belief.tiled_covariance import TiledCovariance
from mapping.kernel import HingeFeatures, outer_features

# Two tiles and a half along x, so that some pairs of tiles are too far apart to be kept.
BOX_M = ((-0.1, -0.02, -0.04), (0.1, 0.02, 0.0))


def make_map(form, **changes):
    return HilbertMap(
        Lattice.from_box(*BOX_M, spacing_m=0.01125),
        MapSettings(form=form, **changes),
        query=Lattice.from_box(*BOX_M, spacing_m=0.01),
    )


def learn(*tumour_maps, n_readings=12):
    rng = np.random.default_rng(0)
    for _ in range(n_readings):
        low_m = np.array([rng.uniform(-0.1, 0.06), -0.02, -0.04])
        points_m = low_m + rng.uniform(0, 0.04, (150, 3))
        for tumour_map in tumour_maps:
            tumour_map.update(points_m, np.linalg.norm(points_m - (0.0, 0.0, -0.02), axis=1) < 0.012)


def test_local_form_agrees_with_the_whole_covariance():
    whole, local = make_map("full"), make_map("local")
    learn(whole, local)
    # What the local form leaves out, correlations over more than eight hinges, moves a probability by less.
    np.testing.assert_allclose(
        local.predict_lattice().probability, whole.predict_lattice().probability, atol=2e-3
    )


def test_local_form_predicts_any_point_as_its_lattice():
    local = make_map("local")
    learn(local)
    carried, anywhere = local.predict_lattice(), local.predict(local.query_points_m())
    np.testing.assert_allclose(anywhere.latent_mean, carried.latent_mean, atol=1e-4)
    np.testing.assert_allclose(anywhere.latent_variance, carried.latent_variance, atol=2e-3)


def test_a_map_that_was_never_told_holds_no_panel():
    local = make_map("local")
    assert local.belief.covariance.n_bytes == 0
    np.testing.assert_allclose(local.predict_lattice().probability, local.settings.prior_prevalence)


@pytest.fixture
def features():
    hinges = Lattice.from_box(*BOX_M, spacing_m=0.0124)
    return HingeFeatures.build(hinges, 4500.0, np.random.default_rng(1).random(hinges.n_points) > 0.1)


def test_tiled_products_are_those_of_the_matrix_within_range(features):
    rng = np.random.default_rng(2)
    tiled, n_weights = TiledCovariance(features, 4.0), features.n_weights
    x_index = np.unravel_index(np.flatnonzero(features.weight_of_hinge >= 0), features.hinges.shape)[0]
    matrix = 4.0 * np.eye(n_weights)
    weights = np.flatnonzero(x_index < 9)
    G = rng.normal(size=(weights.size, 3))
    tiled.lower(weights, G)
    matrix[np.ix_(weights, weights)] -= G @ G.T
    asked = np.flatnonzero((x_index >= 4) & (x_index < 8))
    C = rng.normal(size=(5, asked.size))
    columns, cross = tiled.cross(C, asked)
    # Rounding of sums of some hundred products of order one.
    np.testing.assert_allclose(cross, (C @ matrix[asked])[:, columns], atol=1e-10)
    np.testing.assert_allclose(tiled.among(C, asked), C @ matrix[np.ix_(asked, asked)], atol=1e-10)


@pytest.mark.parametrize("is_masked", [False, True])
def test_dense_covariance_and_its_variance_equal_the_matrix_and_its_quadratic_form(features, is_masked):
    if not is_masked:
        features = HingeFeatures.build(features.hinges, features.gamma_per_m2)
    rng = np.random.default_rng(3)
    query = Lattice.from_counts(*BOX_M, counts=(5, 4, 3))
    carried = CarriedVariance(features, query, 4.0, cutoff=0.0)
    kept = DenseCovariance(features, 4.0, carried, is_exact=True)
    Sigma = 4.0 * np.eye(features.n_weights)
    for sign in (1.0, 1.0, -1.0):
        weights = np.sort(rng.choice(features.n_weights, 40, replace=False))
        G = 0.2 * rng.normal(size=(40, 4))
        kept.lower(weights, G, sign=sign)
        Sigma[np.ix_(weights, weights)] -= sign * G @ G.T
    # Sums of some hundred terms of order one.
    np.testing.assert_allclose(kept.matrix, Sigma, atol=1e-12)
    np.testing.assert_array_equal(kept.matrix, kept.matrix.T)
    points_m = rng.uniform(*BOX_M, (30, 3))
    Phi = outer_features(features.along_axes(points_m))[:, features.weight_of_hinge >= 0]
    quadratic = np.einsum("nj,jk,nk->n", Phi, Sigma, Phi)
    np.testing.assert_allclose(kept.variance_at(points_m, cutoff=0.0), quadratic, atol=1e-11)
    Phi = outer_features(features.along_axes(query.points_m()))[:, features.weight_of_hinge >= 0]
    quadratic = np.einsum("nj,jk,nk->n", Phi, Sigma, Phi)
    np.testing.assert_allclose(kept.variance_on_lattice(query), quadratic, atol=1e-11)


@pytest.mark.parametrize("form", ["full", "local"])
def test_a_mask_changes_which_points_are_answered_and_nothing_else(form):
    hinges, query = Lattice.from_box(*BOX_M, spacing_m=0.01125), Lattice.from_box(*BOX_M, spacing_m=0.008)
    # A slanted slab, so that planes have different ranges and some have none.
    points_m = query.points_m()
    mask = (np.abs(points_m[:, 0] + 2 * points_m[:, 1]) < 0.03) & (points_m[:, 0] > -0.05)
    whole = HilbertMap(hinges, MapSettings(form=form), query=query)
    masked = HilbertMap(hinges, MapSettings(form=form), query=query, query_mask=mask)
    learn(whole, masked)
    expected, answer = whole.predict_lattice(), masked.predict_lattice()
    np.testing.assert_array_equal(answer.latent_mean, expected.latent_mean[mask])
    # Single precision, whose products of other shapes round differently.
    np.testing.assert_allclose(answer.latent_variance, expected.latent_variance[mask], rtol=1e-5)

"""The lattice and its features."""

import numpy as np
import pytest

from mapping import Lattice
from mapping.kernel import AxisFeatures, HingeFeatures, contract, feature_products, outer_features


def test_the_papers_box_holds_2890_hinges():
    lattice = Lattice.from_box((-0.09, -0.09, -0.10125), (0.09, 0.09, 0.0), spacing_m=0.01125)
    assert lattice.shape == (17, 17, 10)
    assert lattice.n_points == 2890
    np.testing.assert_allclose([axis[0] for axis in lattice.axes_m], (-0.09, -0.09, -0.10125), atol=1e-15)


def test_a_box_that_is_no_multiple_of_the_spacing_is_filled_from_its_centre():
    lattice = Lattice.from_box((0, 0, 0), (1.0, 0.25, 0.09), spacing_m=0.1)
    assert lattice.shape == (11, 3, 1)
    np.testing.assert_allclose(lattice.axes_m[1], (0.025, 0.125, 0.225))
    np.testing.assert_allclose(lattice.axes_m[2], (0.045,))


def test_points_run_through_z_fastest():
    lattice = Lattice((np.array([0.0, 1.0]), np.array([0.0, 2.0]), np.array([0.0, 3.0])))
    np.testing.assert_array_equal(lattice.points_m()[:3], [[0, 0, 0], [0, 0, 3], [0, 2, 0]])


@pytest.mark.parametrize(
    ("axes", "complaint"),
    [
        (([0, 1], [0, 1]), "three axes"),
        (([0, 1], [1, 0], [0, 1]), "axis y .* strictly increasing"),
        (([0, np.nan], [0, 1], [0, 1]), "axis x .* finite"),
        (([], [0], [0]), "axis x must be a non-empty"),
    ],
)
def test_axes_that_make_no_lattice_are_refused(axes, complaint):
    with pytest.raises(ValueError, match=complaint):
        Lattice(tuple(np.array(axis, dtype=float) for axis in axes))


def test_a_caller_who_changes_his_axes_does_not_change_the_lattice():
    axis = np.array([0.0, 1.0])
    lattice = Lattice((axis, axis, axis))
    axis[0] = -5
    assert lattice.axes_m[0][0] == 0
    assert not lattice.axes_m[0].flags.writeable


@pytest.fixture
def features():
    return HingeFeatures.build(Lattice.from_box((0, 0, 0), (0.05, 0.04, 0.03), spacing_m=0.01), 7000.0)


def test_features_are_the_squared_exponential_of_eq_1(features):
    points_m = np.random.default_rng(0).uniform(-0.01, 0.05, (20, 3))
    distance = np.linalg.norm(points_m[:, None] - features.hinges.points_m(), axis=2)
    factors = features.along_axes(points_m)
    # Products of three exponentials round a few times more than one: 1e-14 absolute of values up to 1.
    np.testing.assert_allclose(outer_features(factors), np.exp(-7000.0 * distance**2), atol=1e-14)
    Phi = outer_features(factors)
    np.testing.assert_allclose(feature_products(factors, factors), Phi @ Phi.T, atol=1e-13)


def test_contraction_equals_the_dense_sum_on_a_lattice(features):
    query = Lattice.from_counts((0, 0, 0), (0.05, 0.04, 0.03), counts=(4, 3, 5))
    weights = np.random.default_rng(1).normal(size=(*features.hinges.shape, 2))
    dense = outer_features(features.along_axes(query.points_m())) @ weights.reshape(-1, 2)
    np.testing.assert_allclose(
        contract(features.on_lattice(query), weights).reshape(-1, 2), dense, atol=1e-13
    )


def test_the_box_around_points_holds_every_hinge_within_reach(features):
    point_m = np.array([[0.012, 0.02, 0.0]])
    box = features.box_around(point_m, cutoff=0.1)
    Phi = outer_features(features.along_axes(point_m))[0]
    outside = np.ones(features.hinges.shape, dtype=bool)
    outside[box] = False
    assert Phi[outside.ravel()].max() < 0.1
    assert outer_features(AxisFeatures(*features.along_axes(point_m, box))).shape[1] < Phi.size


def test_masked_hinges_have_no_weight():
    mask = np.ones(8, dtype=bool)
    mask[[0, 3]] = False
    features = HingeFeatures.build(Lattice.from_box((0, 0, 0), (1, 1, 1), spacing_m=1.0), 1.0, mask)
    assert features.n_weights == 6
    np.testing.assert_array_equal(features.weight_of_hinge, [-1, 0, 1, -1, 2, 3, 4, 5])

"""Maps that somebody brings along, and the built-in one of a space."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from mapping import (
    DetailedMap,
    DetailSettings,
    HilbertMap,
    Lattice,
    MapSettings,
    MapSpace,
    Prediction,
    TumourMap,
    average_precision,
    make_hilbert_map,
)

LOW_M, HIGH_M = (-0.03, -0.03, -0.04), (0.03, 0.03, 0.0)


class NearestPointMap:
    """A map of thirty lines: what the nearest sensed point was called, believed the less the farther away it is."""

    def __init__(self, space: MapSpace) -> None:
        self._space = space
        self._points_m, self._is_occupied = np.empty((0, 3)), np.empty(0, dtype=bool)

    def update(self, points_m, is_occupied):
        self._points_m = np.concatenate([self._points_m, points_m])
        self._is_occupied = np.append(self._is_occupied, is_occupied)

    def predict_lattice(self):
        prior = np.full(len(self._space.points_m), self._space.settings.prior_prevalence)
        if not len(self._points_m):
            return Prediction.from_probability(prior)
        gap_m, nearest = KDTree(self._points_m).query(self._space.points_m)
        trust = 0.95 * np.exp(-gap_m / 0.01)
        return Prediction.from_probability(trust * self._is_occupied[nearest] + (1 - trust) * prior)

    def save(self, path):
        np.savez(path, points_m=self._points_m, is_occupied=self._is_occupied)


@pytest.fixture
def space():
    hinges = Lattice.from_box(LOW_M, HIGH_M, spacing_m=0.01125)
    query = Lattice.from_box(LOW_M, HIGH_M, spacing_m=0.004)
    return MapSpace(
        hinges=hinges,
        hinge_mask=hinges.points_m()[:, 0] < 0.025,
        query=query,
        is_inside=np.linalg.norm(query.points_m() - (0.0, 0.0, -0.02), axis=1) < 0.025,
        settings=MapSettings(),
    )


def reading(n_points=400):
    points_m = np.random.default_rng(0).uniform(LOW_M, HIGH_M, (n_points, 3))
    return points_m, np.linalg.norm(points_m - (0.0, 0.0, -0.02), axis=1) < 0.012


def test_a_class_of_a_users_own_is_a_map_and_learns(space, tmp_path):
    own = NearestPointMap(space)
    assert isinstance(own, TumourMap)
    own.update(*reading(n_points=4000))
    is_tumour = np.linalg.norm(space.points_m - (0.0, 0.0, -0.02), axis=1) < 0.012
    assert average_precision(own.predict_lattice().score, is_tumour) > 0.9
    own.save(tmp_path / "map.npz")
    assert (tmp_path / "map.npz").exists()


def test_a_class_that_lacks_a_method_is_no_map(space):
    class Forgetful:
        def update(self, points_m, is_occupied): ...

        def predict_lattice(self): ...

    assert not isinstance(Forgetful(), TumourMap)


@pytest.mark.parametrize("detail", [None, DetailSettings()])
def test_the_built_in_map_of_a_space_answers_at_its_points(space, detail):
    made = make_hilbert_map(replace(space, detail=detail))
    assert isinstance(made, TumourMap)
    assert isinstance(made, HilbertMap if detail is None else DetailedMap)
    np.testing.assert_array_equal(made.query_points_m(), space.points_m)
    made.update(*reading())
    assert made.predict_lattice().latent_mean.shape == (len(space.points_m),)


def test_the_built_in_map_is_the_one_made_by_hand(space):
    by_hand = HilbertMap(
        space.hinges,
        space.settings,
        query=space.query,
        query_mask=space.is_inside,
        hinge_mask=space.hinge_mask,
    )
    made = make_hilbert_map(space)
    for each in (made, by_hand):
        each.update(*reading())
    np.testing.assert_array_equal(made.predict_lattice().score, by_hand.predict_lattice().score)
    assert made.n_weights == space.hinge_mask.sum()


def test_a_spaces_points_are_those_of_its_lattice_that_lie_in_the_organ_in_its_order(space):
    np.testing.assert_array_equal(space.points_m, space.query.points_m()[space.is_inside])
    assert space.points_m is space.points_m


def test_a_space_is_not_changed_by_whoever_holds_it(space):
    mask = space.is_inside.copy()
    other = replace(space, is_inside=mask)
    mask[:] = False
    assert other.is_inside.any()
    for array in (other.is_inside, other.hinge_mask, other.points_m):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(FrozenInstanceError):
        other.settings = MapSettings()


@pytest.mark.parametrize("name", ["hinge_mask", "is_inside"])
def test_a_mask_that_does_not_fit_or_keeps_nothing_is_refused(space, name):
    with pytest.raises(ValueError, match=rf"{name} must have shape .* shape \(3,\)"):
        replace(space, **{name: np.ones(3, dtype=bool)})
    with pytest.raises(ValueError, match=rf"{name} .* keeps 0"):
        replace(space, **{name: np.zeros_like(getattr(space, name))})

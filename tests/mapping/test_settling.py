"""What an update puts off until somebody looks: whoever settles it earlier gets the same map, to the last bit."""

import numpy as np
import pytest

from mapping import DetailedMap, HilbertMap, Lattice, MapSettings, Prediction, settle

BOX_M = ((-0.03, -0.03, -0.035), (0.03, 0.02, 0.0))


def make_map(form="full"):
    lattices = [Lattice.from_box(*BOX_M, spacing_m=spacing_m) for spacing_m in (0.011, 0.008)]
    return HilbertMap(lattices[0], MapSettings(form=form), query=lattices[1])


def readings(n=5):
    rng = np.random.default_rng(4)
    for _ in range(n):
        points_m = rng.uniform((-0.03, -0.03, -0.035), (0.01, 0.01, -0.02)) + rng.uniform(0, 0.025, (150, 3))
        yield points_m, np.linalg.norm(points_m - (0.0, 0.0, -0.02), axis=1) < 0.01


def assert_same(one, other):
    states = one.state(), other.state()
    assert states[0].keys() == states[1].keys()
    for name in states[0]:
        np.testing.assert_array_equal(states[0][name], states[1][name], err_msg=name)


@pytest.mark.parametrize("form", ["full", "local", "diagonal"])
def test_maps_that_settle_after_each_reading_and_never_are_the_same(form):
    eager, lazy = DetailedMap(make_map(form)), DetailedMap(make_map(form))
    for points_m, is_occupied in readings():
        for each in (eager, lazy):
            each.update(points_m, is_occupied)
        settle(eager)
    assert_same(eager, lazy)


def test_what_is_put_off_is_done_before_anything_that_depends_on_it():
    points_m, is_occupied = next(readings())
    for ask in (
        lambda each: each.predict(points_m).latent_variance,
        lambda each: each.belief.covariance.matrix,
        lambda each: (each.carry_samples(3, rng=np.random.default_rng(0)), each.sample_lattice())[1],
        lambda each: (each.lay([points_m + 0.004]), each.belief.covariance.matrix)[1],
        lambda each: (each.revise(), each.belief.covariance.matrix)[1],
    ):
        answers = []
        for settles in (False, True):
            tumour_map = make_map()
            tumour_map.update(points_m, is_occupied)
            if settles:
                settle(tumour_map)
            answers.append(ask(tumour_map))
        np.testing.assert_array_equal(*answers)
        assert np.abs(answers[0]).max() > 0.0


def test_a_map_of_ones_own_puts_off_nothing():
    class Flat:
        def update(self, points_m, is_occupied): ...

        def predict_lattice(self):
            return Prediction.from_probability(np.full(4, 0.5))

        def save(self, path): ...

    assert settle(Flat()) is None

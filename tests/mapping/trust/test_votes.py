"""One vote a view: by a plain loop, and independent of how many labels a view has."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logit

from mapping import LabelledPoints, votes


def view(seed: int, n: int = 200, log_odds: float = -2.0) -> LabelledPoints:
    rng = np.random.default_rng(seed)
    said = log_odds * rng.uniform(0.5, 1.5, n)
    return LabelledPoints(rng.uniform(-0.02, 0.02, (n, 3)), said > 0.0, said)


def test_votes_are_those_of_a_plain_loop() -> None:
    readings = [view(0), view(1, log_odds=4.0), view(2, n=3)]
    places_m = np.random.default_rng(9).uniform(-0.025, 0.025, (60, 3))
    log_odds, n_views = votes(places_m, readings, 0.02)
    for place, said, n in zip(places_m, log_odds, n_views, strict=True):
        expected, views = logit(0.02), 0
        for reading in readings:
            gap_m = np.linalg.norm(reading.points_m - place, axis=1)
            if gap_m.min() < 0.005:
                assert reading.log_odds is not None
                expected, views = expected + reading.log_odds[gap_m.argmin()], views + 1
        assert said == pytest.approx(expected)
        assert n == views


@pytest.mark.parametrize("n", [1, 10, 300])
def test_a_view_has_one_vote_however_many_labels_it_has(n: int) -> None:
    points_m = np.random.default_rng(0).uniform(-0.001, 0.001, (n, 3))
    reading = LabelledPoints(points_m, np.zeros(n, bool), np.full(n, -2.5))
    log_odds, n_views = votes(np.zeros((1, 3)), [reading, reading], 0.5)
    assert log_odds[0] == pytest.approx(-5.0)
    assert n_views[0] == 2


def test_a_view_that_says_nothing_of_its_labels_has_no_vote() -> None:
    silent = LabelledPoints(np.zeros((1, 3)), np.ones(1, bool))
    empty = LabelledPoints(np.empty((0, 3)), np.empty(0, bool), np.empty(0))
    log_odds, n_views = votes(np.zeros((1, 3)), [silent, empty], 0.1)
    assert log_odds[0] == pytest.approx(logit(0.1))
    assert n_views[0] == 0

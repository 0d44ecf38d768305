"""Rates that nobody told are found from readings: planted ones, and none where there are none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logit

from mapping import ErrorRates, LabelledPoints, LabelTrust, Prediction, TrustSettings, teach

CENTRES_M = np.array([[-0.02, 0.0, 0.0], [0.02, 0.01, 0.0]])
PLACES_M = np.stack(np.meshgrid(*[np.linspace(-0.045, 0.045, 19)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def is_tumour(points_m):
    return (np.linalg.norm(points_m[:, None] - CENTRES_M, axis=2) < 0.012).any(axis=1)


def learnt(
    n_readings: int, *, flipped: float = 0.0, missed: float = 0.0, invented: float = 0.0
) -> ErrorRates:
    """The rates after readings of two balls, under a map that has found out what is there."""
    rng, trust = np.random.default_rng(3), LabelTrust(TrustSettings())
    map_says = Prediction.from_probability(np.where(is_tumour(PLACES_M), 0.99, 0.001))
    for _ in range(n_readings):
        points_m = rng.uniform(-0.045, 0.045, (1500, 3))
        labels = is_tumour(points_m)
        for centre_m in CENTRES_M:
            if rng.random() < missed:
                labels &= np.linalg.norm(points_m - centre_m, axis=1) > 0.02
        if rng.random() < invented:
            labels |= np.linalg.norm(points_m - rng.uniform(-0.03, 0.03, 3), axis=1) < 0.008
        labels ^= rng.random(len(labels)) < flipped
        trust.observe(trust.judge(LabelledPoints(points_m, labels)), PLACES_M, map_says)
    return trust.rates


def test_flips_are_found_at_their_rate() -> None:
    rates = learnt(25, flipped=0.05)
    assert rates.false_positive == pytest.approx(0.05, abs=0.01)
    assert rates.false_negative == pytest.approx(0.05, abs=0.025)


def test_an_exact_sensor_is_soon_trusted() -> None:
    rates = learnt(20)
    assert rates.false_positive < 2e-3
    assert rates.false_negative < 0.01
    assert rates.missed < 0.02
    assert rates.invented < 1e-3


def test_missed_lesions_are_found_at_their_rate() -> None:
    assert learnt(60, missed=0.25).missed == pytest.approx(0.25, abs=0.08)
    assert learnt(60, missed=0.05).missed == pytest.approx(0.05, abs=0.03)


def test_invented_lesions_are_found_at_their_share_of_the_view() -> None:
    """A ball of 8 mm in a third of the views covers 0.3 per cent of a cube of 90 mm."""
    share = 4 / 3 * np.pi * 0.008**3 / 0.09**3 / 3
    assert learnt(80, invented=1 / 3).invented == pytest.approx(share, rel=0.7)


def test_told_rates_stay_what_they_are() -> None:
    told = ErrorRates(false_positive=0.05, missed=0.1)
    trust = LabelTrust(TrustSettings(rates=told, learns=False))
    points_m = np.random.default_rng(0).uniform(-0.04, 0.04, (500, 3))
    trust.observe(
        trust.judge(LabelledPoints(points_m, is_tumour(points_m))),
        PLACES_M,
        Prediction.from_probability(np.full(len(PLACES_M), 0.5)),
    )
    assert trust.rates == told


def test_who_trusts_labels_as_they_are_passes_them_on() -> None:
    labels = LabelledPoints(np.zeros((3, 3)), np.array([True, False, True]))
    trust = LabelTrust(None)
    assert trust.judge(labels) is labels
    assert trust.rates.missed == 0.0


def test_what_a_sensor_says_itself_is_kept() -> None:
    own = LabelledPoints(np.zeros((2, 3)), np.array([True, False]), np.array([1.0, -2.0]))
    assert LabelTrust(TrustSettings()).judge(own) is own


def test_a_map_that_takes_no_doubts_gets_the_labels_alone() -> None:
    class Plain:
        def update(self, points_m, is_occupied):
            self.got = (points_m, is_occupied)

    class Doubting(Plain):
        def update(self, points_m, is_occupied, *, log_odds=None, weight=None):
            self.got = (points_m, is_occupied, log_odds, weight)

    labels = LabelledPoints(np.zeros((1, 3)), np.array([True]), np.array([2.0]), np.array([0.5]))
    plain, doubting = Plain(), Doubting()
    teach(plain, labels)
    teach(doubting, labels)
    assert len(plain.got) == 2
    assert doubting.got[2] is labels.log_odds
    assert doubting.got[3] is labels.weight


def test_rates_never_reach_one_half() -> None:
    rates = learnt(3, flipped=0.5)
    assert max(rates.false_positive, rates.false_negative, rates.missed, rates.invented) <= 0.45
    assert logit(rates.false_positive) < 0.0

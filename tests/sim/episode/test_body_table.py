"""The table of cases in which the organ is not where it was planned."""

import numpy as np
import pytest
from scipy.special import expit

from benchmarks.body import Options, calibration_text, play, row


def test_seeds_give_episodes_of_their_own() -> None:
    options = Options(scenario="sphere", steps=1)
    first, second = (play(("offset", "contacts", seed), options=options) for seed in (0, 1))
    assert first["early_mm"] != second["early_mm"]
    again = play(("offset", "contacts", 0), options=options)
    # But for the times, an episode is the same again.
    assert again["auprc"] == first["auprc"]
    assert row("offset", "contacts", [first, second], np.zeros(2))[:2] == ["offset", "contacts"]


def test_the_slope_is_that_of_the_probabilities() -> None:
    rng = np.random.default_rng(0)
    log_odds = rng.uniform(-3.5, 3.5, 40_000)
    # The truth is twice as sure as what is said: the map is too timid.
    is_tumour = rng.random(log_odds.size) < expit(2.0 * log_odds)
    half = log_odds.size // 2
    runs = [
        {"log_odds": log_odds[rows].tolist(), "is_tumour": is_tumour[rows].tolist()}
        for rows in (slice(half), slice(half, None))
    ]
    error, slope = calibration_text(runs).split(" (")[0].split(" / ")
    # A slope from so many points is off by 0.02.
    assert float(slope) == pytest.approx(2.0, abs=0.06)
    assert float(error) > 0.05
    assert calibration_text([{"log_odds": [0.5], "is_tumour": [True]}]) == "-"

"""The table of cases in which the organ is not where it was planned: it goes on where it was stopped."""

import numpy as np
import pytest
from scipy.special import expit

from benchmarks.body import Options, calibration_text, play, played, row
from sim.campaign.journal import Journal

OPTIONS = Options(scenario="sphere", steps=1)


class WorkersHere:
    """Does the work in this process, and tells what it did."""

    def __init__(self) -> None:
        self.done: list[tuple[str, str, int]] = []

    def in_order(self, todo, *, lost):
        for run in todo:
            self.done.append(run)
            yield play(run, options=OPTIONS)


def test_episodes_that_the_file_has_are_not_run_again(tmp_path) -> None:
    out, workers = tmp_path / "body.jsonl", WorkersHere()
    todo = [("offset", "contacts", seed) for seed in (0, 1)]
    with Journal(out) as journal:
        rows = played(todo[:1], workers, journal, OPTIONS)
    one = out.read_bytes()
    with Journal(out) as journal:
        both = played(todo, workers, journal, OPTIONS)
    assert workers.done == todo
    # Through JSON they come back as they were.
    assert both[0] == rows[0]
    assert both[0]["early_mm"] != both[1]["early_mm"]
    # The second was cut off in the middle of its line.
    out.write_bytes(out.read_bytes()[:-20])
    with Journal(out) as journal:
        assert len(journal) == 1
        again = played(todo, workers, journal, OPTIONS)
    assert workers.done == [*todo, todo[1]]
    assert out.read_bytes().startswith(one)
    # But for the times, an episode is the same again.
    assert again[1]["auprc"] == both[1]["auprc"]
    assert row("offset", "contacts", again, np.zeros(2))[:2] == ["offset", "contacts"]


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

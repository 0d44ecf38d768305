"""Lesions compared: planted shares come back, seeds are drawn whole, and old campaigns are left out with a sentence."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from test_compare import map_entry, write

from sim.campaign.lesions import LESIONS
from sim.comparison.compare import compare
from sim.comparison.comparison import compare_groups
from sim.comparison.estimates import share_interval, shares_by_cluster
from sim.comparison.lesions.scores import CLASSES
from sim.comparison.trial_groups import load_groups
from sim.findings.free_response import OWN, thresholds

DIAMETERS_M = (0.004, 0.007, 0.010, 0.030)
"""One lesion of each class in every organ."""
N_SEEDS = 12
STEPS = 6


def lesion_entry(seed: int, planner: str, found: tuple[bool, ...], *, n_false: int = 0) -> dict:
    """A trial whose lesions are known: those found were seen with action 2, mapped with 3 and sensed with 4.

    The first lesion is sensed whatever became of it.
    """
    entry = map_entry(seed, planner, [0.5] * STEPS)
    n = len(found)
    entry["row"] |= {
        "n_lesions": n,
        "n_lesions_found": sum(found),
        "lesions_found_fraction": sum(found) / n,
        "n_false_findings": n_false,
    }
    columns = {
        "lesion": list(range(1, n + 1)),
        "is_found": list(found),
        "first_seen_step": [2 if each else None for each in found],
        "sensed_step": [4 if each or i == 0 else None for i, each in enumerate(found)],
        "first_mapped_step": [3 if each else None for each in found],
        "true_diameter_m": list(DIAMETERS_M[:n]),
    }
    levels = thresholds(0.02)
    # Below its own threshold the map would find all, and make up one thing more with each.
    response = {
        "probability": [round(float(1 / (1 + np.exp(-level))), 6) for level in levels],
        "n_found": [n if k < OWN else sum(found) for k in range(len(levels))],
        "n_false": [n_false + max(OWN - k, 0) for k in range(len(levels))],
        "own": OWN,
    }
    return entry | {"findings": {LESIONS: columns, "free_response": response}}


@pytest.fixture
def campaign(tmp_path) -> Path:
    """find-and-outline finds all from 10 mm on and each second seed's 7 mm; random only the largest."""
    entries = []
    for seed in range(N_SEEDS):
        entries.append(
            lesion_entry(seed, "find-and-outline", (False, seed % 2 == 0, True, True), n_false=int(seed == 0))
        )
        entries.append(lesion_entry(seed, "random", (False, False, False, True)))
    return write(tmp_path / "one", entries)


def test_planted_shares_come_back_by_diameter(campaign) -> None:
    comparison = compare_groups(load_groups([campaign]))
    mine, random = comparison.lesions
    shares = dict(zip((each.label for each in CLASSES), mine.by_diameter, strict=True))
    assert {label: None if each is None else (each.n, each.share) for label, each in shares.items()} == {
        "all": (48, 30 / 48),
        "below 5 mm": (12, 0.0),
        "5 to 10 mm": (12, 0.5),
        "10 to 20 mm": (12, 1.0),  # 10 mm itself counts here
        "20 mm and more": (12, 1.0),
        "10 mm and more": (24, 1.0),
    }
    large, small = shares["10 mm and more"], shares["5 to 10 mm"]
    assert large is not None
    assert small is not None
    assert large.interval == share_interval(1.0, N_SEEDS)  # 24 lesions are 12 seeds
    # Half of twelve independent seeds: the bootstrap is near the binomial's 0.5 +- 1.96 sqrt(0.25 / 12).
    assert small.interval == pytest.approx((0.5 - 0.283, 0.5 + 0.283), abs=0.09)
    assert (mine.n_sensed, mine.n_sensed_missed) == (30 + 12, 12)
    assert mine.false_per_run.mean == pytest.approx(1 / 12)
    assert random.false_per_run.interval == (0.0, pytest.approx(-math.log(0.025) / N_SEEDS))
    assert [share.share for share in random.mapped] == [0, 0, 0.25, 0.25, 0.25, 0.25]
    assert [share.share for share in random.seen] == [0, 0.25, 0.25, 0.25, 0.25, 0.25]


def test_the_free_response_is_the_mean_over_trials_at_each_threshold(campaign) -> None:
    mine, _ = compare_groups(load_groups([campaign])).lesions
    response = mine.response
    assert response is not None
    assert response.found[response.own].share == 30 / 48
    assert response.false_per_run[response.own] == pytest.approx(1 / 12)
    assert [share.share for share in response.found[:OWN]] == [1.0] * OWN
    np.testing.assert_allclose(response.false_per_run[:OWN], 1 / 12 + np.arange(OWN, 0, -1))


def test_pairs_are_made_of_the_share_found(campaign) -> None:
    comparison = compare_groups(load_groups([campaign]), reference="find-and-outline")
    (pairing,) = (each for each in comparison.pairings if each.measure.key == "lesions_found_fraction")
    assert pairing.estimate.difference.mean == pytest.approx(0.25 + 0.125)
    assert pairing.estimate.n_wins == N_SEEDS


def test_lesions_of_one_seed_are_drawn_together() -> None:
    """Ten things a cluster that agree say no more than one: the interval is that of the clusters' own shares."""
    rng = np.random.default_rng(1)
    outcomes = (rng.random(40) < 0.6).astype(float)
    clusters = np.repeat(np.arange(40), 10)
    (many,) = shares_by_cluster(np.repeat(outcomes, 10)[:, None], np.ones(400), clusters)
    (one,) = shares_by_cluster(outcomes[:, None], np.ones(40), np.arange(40))
    assert (many.n, many.n_clusters) == (400, 40)
    assert many.share == one.share == outcomes.mean()
    assert many.interval == pytest.approx(one.interval)
    half = 1.96 * math.sqrt(one.share * (1 - one.share) / 40)
    # The bootstrap of a mean has the binomial's width, but for steps of 1/40.
    assert one.interval == pytest.approx((one.share - half, one.share + half), abs=0.03)
    # Rows of one cluster may stand anywhere.
    order = rng.permutation(400)
    (mixed,) = shares_by_cluster(np.repeat(outcomes, 10)[order, None], np.ones(400), clusters[order])
    assert mixed == many


def test_a_single_cluster_has_no_interval_and_empty_ones_do_not_count() -> None:
    (alone,) = shares_by_cluster(np.array([[1.0], [0.0]]), [1, 1], [7, 7])
    assert (alone.share, alone.n_clusters) == (0.5, 1)
    assert math.isnan(alone.interval[0])
    (two,) = shares_by_cluster(np.array([[1.0], [0.0], [0.0]]), [2, 2, 0], [0, 1, 2])
    assert (two.share, two.n, two.n_clusters) == (0.25, 4, 2)


def test_everything_written_says_the_same(campaign, tmp_path) -> None:
    summary = compare([campaign], out=tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "found, 10 mm and more" in summary.text
    for words in ("24 of 24", "6 of 12", "0 of 12", "0.08"):
        assert words in summary.text
        assert words in page
    assert "Free response" in page
    assert {path.name.split("-")[0] for path in summary.figures} >= {"lesions_mapped", "free_response"}
    rows = list(csv.DictReader((tmp_path / "out" / "compare_lesions.csv").open()))
    (large,) = (r for r in rows if r["contender"] == "random" and r["diameter"] == "20 mm and more")
    assert (float(large["fraction"]), large["n_lesions"], large["n_seeds"]) == (1.0, "12", "12")
    assert {row["share"] for row in rows} == {"found", "seen", "mapped", "missed of the 95 % sensed"}


def test_campaigns_from_before_lesions_are_compared_without_them(campaign, tmp_path) -> None:
    others = ("greedy-coverage", "multi-resolution")
    entries = [map_entry(seed, planner, [0.2, 0.4]) for seed in range(4) for planner in others]
    old = write(tmp_path / "old", entries)
    summary = compare([old], out=tmp_path / "out")
    assert "8 of the 8 trials of this case ran before what became of each lesion was kept" in summary.text
    assert "AUPRC" in summary.text
    assert not list((tmp_path / "out").glob("free_response*"))
    assert "ran before what became" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    both = compare([campaign, old], out=tmp_path / "both").text
    assert "8 of the 32 trials" in both
    assert "24 of 24" in both


def test_episodes_stopped_by_what_they_sensed_are_left_out(tmp_path) -> None:
    entries = [lesion_entry(seed, "random", (True, False)) for seed in range(3)]
    for entry in entries:
        entry["settings"]["until_sensed"] = 0.95
    comparison = compare_groups(load_groups([write(tmp_path / "one", entries)]))
    assert not comparison.lesions
    assert "Lesions" not in compare([tmp_path / "one"], out=tmp_path / "out").text


def test_the_table_of_lesions_fits_a_page_of_800_px(browser, campaign, tmp_path) -> None:
    compare([campaign], out=tmp_path / "out")
    page = browser.new_page(viewport={"width": 800, "height": 900})
    page.goto((tmp_path / "out" / "report.html").as_uri())
    hidden = "[...document.querySelectorAll('h3 + .wide')].map(each => each.scrollWidth - each.clientWidth)"
    assert max(page.evaluate(hidden)) == 0
    page.close()

"""Comparisons: a planted truth comes back, no trial is dropped unseen, and the figures show it."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sim.campaign.campaign_folder import FORMAT
from sim.campaign.journal import encoded
from sim.comparison.compare import compare
from sim.comparison.comparison import compare_groups
from sim.comparison.trial_groups import load_groups
from sim.errors import UsageError

STEPS = 100


def entry(seed: int, planner: str, *, needed: int | None, **more) -> dict:
    sensed = 1.0 if needed else 0.5
    row = {
        "status": "finished",
        "n_sensings": needed or STEPS,
        "sensings_to_95": needed,
        "sensed_fraction": sensed,
    }
    settings = {"scenario": "sphere", "planner": planner, "arm": "none", "seed": seed, "steps": STEPS}
    settings |= {"until_sensed": 0.95} | more
    return {"settings": settings, "row": row, "timings": {}, "curves": {"sensed_fraction": [sensed]}}


def map_entry(seed: int, planner: str, auprc: list[float], **more) -> dict:
    settings = {
        "scenario": "liver",
        "planner": planner,
        "arm": "default",
        "seed": seed,
        "steps": len(auprc),
    } | more
    row = {"status": "finished", "n_sensings": len(auprc), "sensings_to_95": None, "sensed_fraction": 0.5}
    row |= {"auprc": auprc[-1], "n_points": 100, "n_occupied": 5}
    curves = {"sensed_fraction": [0.5] * len(auprc), "auprc": auprc, "precision": [auprc[-1]] * 50}
    return {"settings": settings, "row": row, "timings": {}, "curves": curves}


def write(folder: Path, entries: list[dict], commit: str = "abc") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "journal.jsonl").write_bytes(b"".join(map(encoded, entries)))
    machine = {"sounding": "1", "commit": commit, "packages": {}, "platform": "here"}
    (folder / "study.json").write_text(json.dumps({"format": FORMAT, "machine": machine}))
    return folder


@pytest.fixture
def campaign(tmp_path) -> Path:
    """30 seeds on which planner a needs 10 actions fewer than b, but never gets there on three of them."""
    rng = np.random.default_rng(0)
    hardness = rng.integers(15, 60, 30)
    entries = []
    for seed, needed in enumerate(hardness.tolist()):
        entries.append(entry(seed, "random", needed=needed))
        entries.append(entry(seed, "expected-improvement", needed=None if seed < 3 else needed - 10))
    rng.shuffle(entries)
    return write(tmp_path / "one", entries)


def test_trials_that_never_get_there_count_with_the_horizon_and_in_the_median(campaign) -> None:
    comparison = compare_groups(load_groups([campaign]))
    (case,) = comparison.cases
    score = comparison.score(case, "expected-improvement", "sensings_to_95")
    other = comparison.score(case, "random", "sensings_to_95")
    assert score is not None
    assert other is not None
    assert (score.n_never, other.n_never, score.horizon) == (3, 0, STEPS)
    by_hand = np.random.default_rng(0).integers(15, 60, 30).astype(float)
    needed = np.where(np.arange(30) < 3, np.inf, by_hand - 10)
    assert score.estimate.mean == np.where(np.isinf(needed), STEPS, needed).mean()
    assert score.median == np.median(needed)
    assert other.estimate.mean == by_hand.mean()


def test_pairs_are_made_by_seed_whatever_the_order_of_running(campaign) -> None:
    (pairing,) = compare_groups(load_groups([campaign]), reference="random").pairings
    assert (pairing.first, pairing.second) == ("random", "expected-improvement")
    by_hand = np.random.default_rng(0).integers(15, 60, 30).astype(float)
    difference = by_hand - np.where(np.arange(30) < 3, STEPS, by_hand - 10)
    assert pairing.estimate.difference.mean == pytest.approx(difference.mean())
    assert (pairing.estimate.n_wins, pairing.estimate.n) == (3, 30)


def test_a_subset_of_the_seeds_can_be_compared(campaign) -> None:
    (ei, random) = sorted(load_groups([campaign], seeds=range(3, 9)), key=lambda group: group.contender)
    assert ei.seeds.tolist() == random.seeds.tolist() == list(range(3, 9))
    comparison = compare_groups([ei, random])
    assert all(math.isinf(score.horizon) for score in comparison.scores)
    assert comparison.pairings[0].estimate.difference.mean == -10


def test_failed_trials_are_told_and_left_out_of_figures_alone(campaign, tmp_path, capsys) -> None:
    failed = entry(99, "random", needed=5)
    failed["row"] = {"status": "failed", "error": "WorldError: no place"}
    with (campaign / "journal.jsonl").open("ab") as file:
        file.write(encoded(failed))
    summary = compare((campaign,), out=tmp_path / "out")
    assert "1 trials of this case have no result" in summary.text
    assert "seed 99: WorldError: no place" in summary.text


def test_campaigns_with_equal_trials_are_told_apart_by_folder(tmp_path) -> None:
    folders = tuple(
        write(
            tmp_path / name,
            [entry(seed, "random", needed=20 + seed + more) for seed in range(6)],
            commit=name,
        )
        for name, more in (("old", 0), ("new", 5))
    )
    summary = compare(folders, out=tmp_path / "out")
    assert "random (old) − random (new)" in summary.text
    assert "The campaigns were run with different versions: commit differs." in summary.text
    rows = list(csv.DictReader((tmp_path / "out" / "compare.csv").open()))
    (pair,) = [row for row in rows if row["against"]]
    assert (float(pair["mean"]), pair["n_wins"], pair["n"]) == (-5.0, "6", "6")


def test_folders_of_one_name_are_told_apart_and_one_named_twice_counts_once(tmp_path) -> None:
    folders = [
        write(tmp_path / parent / "planners", [entry(seed, "random", needed=20 + more) for seed in range(3)])
        for parent, more in (("may", 0), ("june", 5))
    ]
    groups = load_groups([*folders, folders[0]])
    assert [(group.contender, len(group.entries)) for group in groups] == [
        ("random (may/planners)", 3),
        ("random (june/planners)", 3),
    ]
    (alone,) = load_groups([folders[0], folders[0]])
    assert (alone.contender, len(alone.entries)) == ("random", 3)


def test_settings_that_differ_name_the_contenders(tmp_path) -> None:
    entries = [
        map_entry(seed, "expected-improvement", [0.1, value], **more)
        for seed in range(6)
        for value, more in ((0.5, {}), (0.7, {"ei_threshold_deg": 10.0}))
    ]
    comparison = compare_groups(load_groups([write(tmp_path / "one", entries)]))
    names = {group.contender for group in comparison.groups}
    assert names == {
        "expected-improvement, ei_threshold_deg 5.0",
        "expected-improvement, ei_threshold_deg 10.0",
    }
    (pairing,) = [pairing for pairing in comparison.pairings if pairing.measure.key == "auprc"]
    assert abs(pairing.estimate.difference.mean) == pytest.approx(0.2)


def test_trials_of_one_planner_that_end_after_other_numbers_of_actions_are_never_pooled(tmp_path) -> None:
    folders = [
        write(tmp_path / name, [map_entry(seed, "random", [0.1 * seed] * n) for seed in range(6)])
        for name, n in (("short", 3), ("long", 12))
    ]
    groups = [load_groups(order) for order in (folders, folders[::-1])]
    for found in groups:
        assert {group.contender for group in found} == {"random, steps 3", "random, steps 12"}
        assert all(len(set(group.seeds.tolist())) == len(group.entries) == 6 for group in found)
    # Another planner of the same case may have had other numbers: that planner's name says so, too.
    stopped = write(tmp_path / "stopped", [entry(seed, "random", needed=3) for seed in range(6)])
    longer = [entry(seed, "random", needed=3, until_sensed=0.99) for seed in range(6)]
    found = load_groups([stopped, write(tmp_path / "longer", longer)])
    assert {group.contender for group in found} == {"random, until_sensed 0.95", "random, until_sensed 0.99"}


def test_a_trial_that_its_planner_ended_was_given_up_where_it_ended(tmp_path) -> None:
    stops = {"until_sensed": None, "until_confident": 0.95}
    entries = [entry(seed, "random", needed=None, **stops) for seed in range(6)]
    for each, n in zip(entries, (40, 30, 50, 60, 70, 100), strict=True):
        each["row"]["n_sensings"] = n
    entries += [entry(seed, "expected-improvement", needed=80, **stops) for seed in range(6)]
    comparison = compare_groups(load_groups([write(tmp_path / "one", entries)]))
    scores = {score.contender: score for score in comparison.scores if score.measure.key == "sensings_to_95"}
    # Beyond 30 actions nothing is known of random.
    assert {score.horizon for score in scores.values()} == {30.0}
    assert [score.estimate.mean for score in scores.values()] == [30.0, 30.0]
    assert scores["random"].n_never == 6


@pytest.mark.parametrize("stop", [{"until_confident": 0.95}, {"miss_cost": 100.0}])
def test_scores_at_the_end_are_not_compared_where_planners_ended_their_episodes(tmp_path, stop) -> None:
    entries = [map_entry(seed, "random", [0.1] * (2 + seed), steps=30, **stop) for seed in range(6)]
    comparison = compare_groups(load_groups([write(tmp_path / "one", entries)]))
    assert "auprc" not in {score.measure.key for score in comparison.scores}


def test_scores_at_the_end_are_not_compared_where_episodes_stopped_at_a_goal(campaign) -> None:
    assert {score.measure.key for score in compare_groups(load_groups([campaign])).scores} == {
        "sensings_to_95"
    }


def test_a_map_s_campaign_gets_curves_and_all_figures_show_something(campaign, tmp_path) -> None:
    rng = np.random.default_rng(1)
    curves = [
        map_entry(seed, planner, np.clip(np.linspace(0, top, 20) + rng.normal(0, 0.05, 20), 0, 1).tolist())
        for seed in range(8)
        for planner, top in (("expected-improvement", 0.9), ("random", 0.4))
    ]
    other = write(tmp_path / "maps", curves)
    summary = compare((campaign, other), out=tmp_path / "out")
    names = [re.sub(r"-(sphere|liver).*", "", path.name) for path in summary.figures]
    assert names == ["sensings", "reached", "sensings", "reached", "auprc", "precision_recall"]
    for path in summary.figures:
        pixels = np.asarray(Image.open(path).convert("L"))
        assert min(pixels.shape) > 300
        assert (pixels < 128).mean() > 0.001
    assert (tmp_path / "out" / "compare.md").read_text() == summary.text


def test_an_episode_that_ended_early_keeps_its_last_value_on_the_curve(tmp_path) -> None:
    entries = [map_entry(0, "random", [0.1, 0.2, 0.3], steps=3), map_entry(1, "random", [0.5], steps=3)]
    (group,) = load_groups([write(tmp_path / "one", entries)])
    assert group.curve("auprc").tolist() == [[0.1, 0.2, 0.3], [0.5, 0.5, 0.5]]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"reference": "greedy"}, "reference=greedy: choose one of"),
        ({"seeds": range(500, 600)}, "no trial is done there yet"),
        ({"folders": (Path("/nowhere"),)}, "holds no campaign"),
        ({"view_seed": 777}, "view_seed=777: no trial has that seed"),
    ],
)
def test_what_cannot_be_compared_is_said(campaign, tmp_path, change, text) -> None:
    with pytest.raises(UsageError, match=text):
        compare(**{"folders": (campaign,), "out": tmp_path / "out"} | change)

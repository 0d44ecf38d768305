"""A comparison beside the limit: ratios, seeds that are not known, horizons, and folders that do not fit."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from test_compare import entry, write

from sim.bound.cover import CoverBound
from sim.bound.folder import BoundFolder
from sim.bound.hindsight import SeedBound
from sim.bound.policy import PolicyBound
from sim.bound.policy_study import policy_summary
from sim.cli.command_line import main
from sim.comparison.compare import compare
from sim.errors import UsageError

FEWEST = (1, 2, 3, None)


def seed_bound(seed, fewest):
    cover = None
    if fewest is not None:
        cover = CoverBound(
            least=fewest,
            solver_least=fewest,
            chosen=tuple(range(fewest)),
            value=float(fewest),
            prices=np.zeros(500),
            worth=0.0,
        )
    return SeedBound(seed=seed, n_tumours=1, n_points=500, need=475, cover=cover)


def bound_folder(path, *, scenario="sphere", status="finished"):
    """A bound on four seeds, and of policies that are done with at most half of the places after two actions."""
    policy = PolicyBound(
        n_tumours=1, n_places=100, shares=(0.0, 0.5, 1.0), weighted=None, most_weight=None, fewest=(1,),
    )  # fmt: skip
    with BoundFolder(path) as folder:
        question = {"sounding": "0", "options": {}, "goal": 0.95, "n_places": 100, "first_place": 0}
        content = question | {"seeds": "0:4", "status": status, "policy": policy_summary(policy)}
        folder.begin(content | {"case": {"scenario": scenario, "arm": "none"}})
        for seed, fewest in enumerate(FEWEST):
            folder.write_seed(seed_bound(seed, fewest))
    return path


@pytest.fixture
def campaign(tmp_path):
    entries = [entry(seed, "random", needed=needed) for seed, needed in enumerate((4, 6, 8, None, 10))]
    return write(tmp_path / "campaign", entries)


def limit_rows(folder):
    rows = csv.DictReader((folder / "compare.csv").open())
    return {row["contender"]: float(row["mean"]) for row in rows if row["measure"] == "limit"}


def test_contenders_stand_beside_the_least_possible(campaign, tmp_path):
    summary = compare((campaign,), seeds=range(3), bound=[bound_folder(tmp_path / "bound")])
    # 4, 6 and 8 actions where 1, 2 and 3 are enough. Any policy takes 1 + 1 + 0.5 + 0.25 in the mean: after three
    # actions a quarter of the seeds forbids that more than three quarters are done.
    assert (
        "| random    | 3     | 6.00 | 2.00         | 3.00 x     | 2.75       | 2.18 x     |" in summary.text
    )
    assert limit_rows(summary.folder) == {"in hindsight": 2.0, "any policy": 2.75}
    page = (summary.folder / "report.html").read_text(encoding="utf-8")
    assert "3.00 x" in page
    assert "2.18 x" in page
    by_seed = page[page.index("Numbers by seed") :]
    assert '<th scope="row" class="n">1</th><td class="n">2</td><td class="n">6</td>' in by_seed


def test_what_takes_longer_than_the_horizon_counts_alike_on_both_sides(campaign, tmp_path):
    summary = compare((campaign,), bound=[bound_folder(tmp_path / "bound")])
    # The seed that no poses can sense counts with the horizon for both, and the fifth has no optimum.
    horizon = 100.0
    assert limit_rows(summary.folder)["in hindsight"] == pytest.approx((1 + 2 + 3 + horizon) / 4)
    assert "| random    | 4     |" in summary.text


def test_a_contender_that_never_got_there_is_no_times_the_least(tmp_path):
    entries = [entry(seed, "random", needed=None) for seed in range(3)]
    entries += [entry(seed, "greedy-coverage", needed=6) for seed in range(3)]
    text = compare((write(tmp_path / "c", entries),), bound=[bound_folder(tmp_path / "bound")]).text
    rows = {line.split("|")[1].strip(): line.split("|")[2:-1] for line in text.splitlines() if "| " in line}
    assert [cell.strip() for cell in rows["random"]][-5:] == ["100.00", "2.00", "–", "2.75", "–"]
    assert "counts at most 100 actions, on both sides" in text


@pytest.mark.parametrize("more", [{"sense": "sweep"}, {"tissue": "elastic"}, {"registration_mm": 5.0}])
def test_contenders_whose_actions_a_bound_does_not_count_are_left_out_and_named(tmp_path, more):
    entries = [entry(seed, "random", needed=4) for seed in range(3)]
    entries += [entry(seed, "greedy-coverage", needed=6, **more) for seed in range(3)]
    text = compare((write(tmp_path / "c", entries),), bound=[bound_folder(tmp_path / "bound")]).text
    table = text[text.index("beside the least possible") :]
    ((name, value),) = more.items()
    assert "greedy-coverage is left out" in table
    assert f"ran with {name.replace('_', '-')} {value}" in table
    assert sum(line.startswith("| greedy-coverage") for line in table.split("\n\n")[1].splitlines()) == 0


def test_where_all_contenders_are_left_out_the_comparison_says_why(tmp_path):
    entries = [entry(seed, "random", needed=4, sense="sweep") for seed in range(3)]
    text = compare((write(tmp_path / "c", entries),), bound=[bound_folder(tmp_path / "bound")]).text
    assert "random is left out: a bound counts actions that hold one cone each" in text


def test_without_a_bound_nothing_is_said_of_a_limit(campaign):
    summary = compare((campaign,))
    assert "least possible" not in summary.text
    assert "in hindsight" not in (summary.folder / "report.html").read_text(encoding="utf-8")
    assert limit_rows(summary.folder) == {}


def test_a_bound_of_another_case_is_refused(campaign, tmp_path, capsys):
    other = bound_folder(tmp_path / "other", scenario="liver")
    assert main(["compare", str(campaign), "--bound", str(other)]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"sounding: --bound {other}: is of liver, arm none")
    assert "sphere, arm none" in told


def test_a_bound_that_is_not_finished_is_refused(campaign, tmp_path):
    with pytest.raises(UsageError, match="is not finished"):
        compare((campaign,), bound=[bound_folder(tmp_path / "bound", status="unfinished")])

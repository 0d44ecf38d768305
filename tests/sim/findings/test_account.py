"""The account of a run says which tumours were found, how large and deep they are, why it ended, and how sure it is."""

import numpy as np
import pytest
import trimesh

from sim.campaign.study import make_study
from sim.campaign.trial import run_trial
from sim.findings.account import MEANING, PAPER, account, read_account
from sim.running.run_episode import run_episode
from sim.tables import read_rows


def row(number: int, *, is_found: bool | None, sensed: float = 0.58) -> dict:
    return {
        "tumour": number,
        "is_found": is_found,
        "true_diameter_m": 0.024,
        "true_depth_m": 0.031,
        "sensed_fraction": sensed,
    }


def findings(*rows: dict, n_false: int = 0) -> dict:
    n_found = sum(bool(each["is_found"]) for each in rows)
    return {"n_tumours": len(rows), "n_tumours_found": n_found, "n_false_findings": n_false, "tumours": rows}


OPTIONS = {"planner": "find-and-outline", "sure_radius_mm": 8.0, "until_confident": 0.9, "until_sensed": 0.95}
OPTIONS |= {"miss_cost": 60.0}
ENDED = {"planner": "find-and-outline", "n_sensings": 30, "ended_by": "steps", "confidence": 0.42}


def test_it_leads_with_the_tumours_found_and_names_each() -> None:
    told = account(ENDED, OPTIONS, findings(row(1, is_found=True), row(2, is_found=False), n_false=1))
    assert told.found == ("1 of 2 tumours found, 1 false finding",)
    assert [each.name for each in told.lesions] == ["tumour 1", "tumour 2"]
    assert [each.found for each in told.lesions] == ["found", "missed"]
    assert told.lesions[0].size == "24 mm across, centre 31 mm deep"
    assert told.lesions[0].sensed == "58% sensed"


@pytest.mark.parametrize(
    ("ended_by", "words"),
    [
        ("steps", ["30 actions", "as many as were asked for", "42.0% sure", "8 mm radius"]),
        ("confident", ["because the planner was 42.0% sure", "it was to stop at 90%"]),
        ("sensed", ["95% sensed at which it was to stop"]),
        ("no_pose_left", ["no pose was left"]),
        (
            "not_worth",
            ["nothing was left to outline", "a missed lesion worth 60 actions; the planner was 42.0% sure"],
        ),
    ],
)
def test_it_says_why_the_run_ended(ended_by: str, words: list[str]) -> None:
    told = account(ENDED | {"ended_by": ended_by}, OPTIONS, findings(row(1, is_found=True)))
    assert all(each in told.ended for each in words)


def test_it_says_what_is_expected_to_be_left_and_what_nobody_could_see() -> None:
    left = {
        "n_lesions_counted": 2,
        "lesions_left_expected": 0.4321,
        "unseeable_share": 0.069,
        "lesions_unseeable_expected": 0.25,
    }
    told = account(ENDED | left, OPTIONS, findings(row(1, is_found=True)))
    assert (
        "counts 2 lesions that a reading met, and expects 0.43 more that some pose could find" in told.ended
    )
    assert "0.25 that no pose could" in told.ended
    assert "6.9% are out of every pose's sight" in told.ended


@pytest.mark.parametrize(
    ("needed", "limit", "said"),
    [
        (
            8,
            {"in_hindsight": 2, "is_possible": True, "least_mean": 6.664},
            "95 % of the tumours was sensed after 8 actions, 4.0 times the least possible: with the truth known, 2 "
            "actions would have been enough. Not knowing the truth, no planner needs fewer than 6.66 in the mean "
            "over seeds.",
        ),
        (
            None,
            {"in_hindsight": 1, "is_possible": True, "least_mean": None},
            "95 % of the tumours was not sensed: with the truth known, 1 action would have been enough.",
        ),
        (
            None,
            {"in_hindsight": None, "is_possible": False, "least_mean": None},
            "95 % of the tumours was not sensed: no poses are enough for that, however many.",
        ),
        (
            3,
            {"in_hindsight": None, "is_possible": None, "least_mean": 6.0},
            "95 % of the tumours was sensed after 3 actions; the least possible for this seed is not known. Not "
            "knowing the truth, no planner needs fewer than 6.00 in the mean over seeds.",
        ),
    ],
)
def test_it_holds_the_actions_against_the_least_possible(needed, limit, said) -> None:
    told = account(ENDED | {"sensings_to_95": needed, "limit": limit}, OPTIONS, findings())
    assert told.limit == said
    assert account(ENDED | {"sensings_to_95": needed}, OPTIONS, findings()).limit == ""


def test_a_run_and_a_trial_that_stop_by_cost_say_the_same(tmp_path) -> None:
    options = {
        "scenario": "sphere",
        "arm": "none",
        "motion": "none",
        "steps": 40,
        "miss_cost": 2.0,
    }
    summary = run_episode(**options, out=tmp_path / "cost", report=False, show_progress=False)
    assert summary["ended_by"] == "not_worth"
    assert summary["n_sensings"] < 40
    [trial] = make_study(planner="find-and-outline", **options).trials()
    row = run_trial(trial).row
    told = (
        "n_sensings",
        "n_lesions_counted",
        "lesions_left_expected",
        "unseeable_share",
        "lesions_unseeable_expected",
    )
    assert {name: row[name] for name in told} == {name: summary[name] for name in told}


def test_a_planner_without_confidence_claims_none_and_the_papers_is_explained() -> None:
    summary = {"planner": "expected-improvement", "n_sensings": 1, "ended_by": "steps", "confidence": None}
    told = account(summary, {"planner": "expected-improvement"}, findings(row(1, is_found=True)))
    assert told.ended == "It ended after 1 action, as many as were asked for."
    assert told.meaning == f"{MEANING} {PAPER}"


def test_without_tumours_or_without_a_map_nothing_is_called_found() -> None:
    assert account(ENDED, OPTIONS, findings()).found == ("no tumours in this organ, no false finding",)
    told = account({}, OPTIONS, findings(row(1, is_found=None)))
    assert told.found == ("1 tumour; no map was kept that could find it",)
    assert (told.ended, told.meaning, told.lesions[0].found) == ("", "", "")


def test_the_depth_and_diameter_of_a_ball_and_the_confidence_are_those_of_the_run(tmp_path) -> None:
    options = {"scenario": "sphere", "arm": "none", "motion": "none", "steps": 6, "frames": "none"}
    summary = run_episode(**options, out=tmp_path / "sure", show_progress=False)
    steps = read_rows(tmp_path / "sure" / "steps.csv")
    assert list(steps[0])[-1] == "confidence"
    assert float(steps[-1]["confidence"]) == summary["confidence"]
    with np.load(tmp_path / "sure" / "anatomy.npz") as arrays:
        organ = trimesh.Trimesh(arrays["organ_vertices_m"], arrays["organ_faces"])
        ball = arrays["tumour0_vertices_m"]
    [tumour] = read_rows(tmp_path / "sure" / "tumours.csv")
    # Of 100,000 points strewn on the organ's 0.08 m^2, the nearest lies some millimetres beside the closest one.
    strewn, _ = trimesh.sample.sample_surface(organ, 100_000, seed=0)
    away = np.linalg.norm(strewn - (ball.min(axis=0) + ball.max(axis=0)) / 2, axis=1).min()
    assert float(tumour["true_depth_m"]) == pytest.approx(away, abs=0.0005)
    # The volume of a ball of facets is below that of the ball by up to some percent.
    assert float(tumour["true_diameter_m"]) == pytest.approx(np.ptp(ball[:, 0]), rel=0.03)
    assert read_account(tmp_path / "sure", summary).ended.startswith("It ended after 6 actions")
    summary = run_episode(**options, planner="random", out=tmp_path / "random", show_progress=False)
    assert "confidence" not in read_rows(tmp_path / "random" / "steps.csv")[0]
    assert summary["confidence"] is None

"""The lesions of a campaign: a planted outcome comes back, in the words of a single run, and old journals go on."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from engine_here import EngineHere
from planted_map import LARGE, MADE_UP, MAPPED, write_case

from sim.campaign.campaign import run_trials
from sim.campaign.journal import decoded, encoded
from sim.campaign.lesions import rows_of
from sim.campaign.study import make_study
from sim.running.run_episode import run_episode

OPTIONS = {"planner": "random", "arm": "none", "motion": "none", "steps": 3, "prior_prevalence": 0.02}


def table(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Path:
    return write_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="module")
def campaign(case, tmp_path_factory) -> Path:
    """Two seeds of the planted case with the map that knows its answer, and two without any map."""
    out = tmp_path_factory.mktemp("campaign") / "out"
    maps = ["planted_map:PlantedMap", "when-needed"]
    study = make_study(scenario=str(case), map=maps, seed="0:2", **OPTIONS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.campaign.campaign.make_engine", EngineHere)
        assert run_trials(study, out, jobs=1).n_failed == 0
    return out


def test_a_planted_outcome_is_what_the_rows_say(campaign) -> None:
    rows = table(campaign / "lesions.csv")
    assert [(row["map"], row["seed"], row["lesion"]) for row in rows] == [
        (name, seed, lesion)
        for name in ("planted_map:PlantedMap", "when-needed")
        for seed in "01"
        for lesion in "12"
    ]
    large, small = rows[:2]
    assert (large["is_found"], small["is_found"]) == ("1", "0")
    assert (large["first_mapped_step"], small["first_mapped_step"]) == (str(MAPPED[0]), "")
    true_m = [float(large[f"true_centroid_{axis}_m"]) for axis in "xyz"]
    np.testing.assert_allclose(true_m, LARGE[0], atol=1e-5)  # STL has single precision
    # The map is 2 mm off, and a lattice of 3 mm misses a ball by some tenths of a millimetre.
    assert float(large["centroid_error_m"]) == pytest.approx(0.002, abs=3e-4)
    r, d = LARGE[1], 0.002
    lens = (4 * r + d) * (2 * r - d) ** 2 / (16 * r**3)
    assert float(large["dice"]) == pytest.approx(lens, abs=0.03)
    assert (small["dice"], small["mapped_volume_m3"], small["surface_mean_m"]) == ("0.0", "0.0", "")
    assert float(large["highest_probability"]) > 0.9 > 0.1 > float(small["highest_probability"])
    assert float(small["true_diameter_m"]) == pytest.approx(0.008, rel=0.02)  # of a ball with flat faces


def test_without_a_map_the_rows_tell_only_what_the_cones_held(campaign) -> None:
    for row in table(campaign / "lesions.csv")[4:]:
        assert row["is_found"] == row["dice"] == row["first_mapped_step"] == row["highest_probability"] == ""
        assert 0.0 <= float(row["sensed_fraction"]) <= float(row["attainable_fraction"]) <= 1.0
    for row in table(campaign / "trials.csv")[2:]:
        assert row["n_lesions"] == "2"
        assert row["n_lesions_found"] == row["lesions_found_fraction"] == row["n_false_findings"] == ""


def test_the_rows_of_trials_count_the_rows_of_lesions(campaign) -> None:
    lesions, false = table(campaign / "lesions.csv")[:4], table(campaign / "false_findings.csv")
    assert [(row["seed"], row["finding"], row["first_mapped_step"]) for row in false] == [
        (seed, "1", str(MADE_UP[0])) for seed in "01"
    ]
    for row in table(campaign / "trials.csv")[:2]:
        own = [each for each in lesions if each["seed"] == row["seed"]]
        assert (row["n_lesions"], row["n_lesions_found"], row["lesions_found_fraction"]) == ("2", "1", "0.5")
        assert (row["n_lesions_10mm"], row["n_lesions_10mm_found"]) == ("1", "1")
        assert (row["lesions_10mm_found_fraction"], row["n_false_findings"]) == ("1.0", "1")
        true_m3 = sum(float(each["true_volume_m3"]) for each in own)
        mapped_m3 = sum(float(each["mapped_volume_m3"]) for each in own) + float(false[0]["volume_m3"])
        assert float(row["volume_error_fraction"]) == pytest.approx((mapped_m3 - true_m3) / true_m3)
        attainable = np.mean([float(each["attainable_fraction"]) for each in own])
        assert float(row["attainable_fraction"]) == pytest.approx(attainable)  # 500 points a lesion
        assert float(row["sensed_fraction"]) == pytest.approx(
            np.mean([float(each["sensed_fraction"]) for each in own])
        )


def test_a_trial_says_of_its_lesions_what_a_run_says(case, campaign, tmp_path) -> None:
    summary = run_episode(
        scenario=str(case), tumour_map="planted_map:PlantedMap", seed=1, out=tmp_path / "run", report=False,
        frames="none", show_progress=False, **OPTIONS,
    )  # fmt: skip
    row = table(campaign / "trials.csv")[1]
    assert {name: row[name] for name in summary if "lesions" in name or "false" in name} == {
        name: str(value) for name, value in summary.items() if "lesions" in name or "false" in name
    }
    assert float(row["volume_error_fraction"]) == summary["volume_error_fraction"]
    for name, own in (("tumours.csv", "lesions.csv"), ("false_findings.csv", "false_findings.csv")):
        mine = [
            each for each in table(campaign / own) if each["seed"] == "1" and each["map"] != "when-needed"
        ]
        theirs = table(tmp_path / "run" / name)
        assert len(mine) == len(theirs) > 0
        for one, other in zip(mine, theirs, strict=True):
            assert {name: one[name] for name in other if name != "tumour"} == {
                name: value for name, value in other.items() if name != "tumour"
            }
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["n_lesions_found"] == 1


def test_a_journal_from_before_lesions_goes_on(case, campaign, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("sim.campaign.campaign.make_engine", EngineHere)
    lines = (campaign / "journal.jsonl").read_bytes().splitlines(keepends=True)
    old = decoded(lines[0])
    assert old is not None
    del old["findings"]
    old["row"] = {name: value for name, value in old["row"].items() if "lesions" not in name}
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "study.json").write_bytes((campaign / "study.json").read_bytes())
    (tmp_path / "out" / "journal.jsonl").write_bytes(encoded(old))
    assert rows_of(old, "lesions.csv") is None
    study = make_study(scenario=str(case), map="planted_map:PlantedMap", seed="0:2", **OPTIONS)
    assert run_trials(study, tmp_path / "out", jobs=1).n_run == 1
    assert [row["seed"] for row in table(tmp_path / "out" / "lesions.csv")] == ["1", "1"]
    assert [row["n_lesions_found"] for row in table(tmp_path / "out" / "trials.csv")] == ["", "1"]

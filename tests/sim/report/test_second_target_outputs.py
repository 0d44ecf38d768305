"""What a run, a trial and a campaign tell of a second class of targets."""

from __future__ import annotations

import csv
import dataclasses
import json
import shutil
from pathlib import Path

import nibabel
import numpy as np
import pytest
import trimesh
from engine_here import EngineHere
from PIL import Image
from planted_run import planted_run
from scanned_ball import CENTRE_MM, RADIUS_MM
from two_classes import CYSTS_MM, N_ACTIONS, options, write_meshes

from mapping import average_precision
from sim.campaign.study import Trial
from sim.campaign.tables import curve_arrays
from sim.campaign.trial import run_trial
from sim.cli.command_line import main
from sim.findings.results import findings_of
from sim.findings.tables import finding_summary, write_finding_tables
from sim.pictures.figures import AMBER, BLUE, PURPLE, TargetCurves, draw_precision_recall, draw_progress
from sim.record.recording import read_recording
from sim.record.run_record import load_run
from sim.report import write_report


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Path:
    return write_meshes(tmp_path_factory.mktemp("two"))


@pytest.fixture
def run(two_class_run) -> Path:
    """A run's folder, which is only read."""
    return two_class_run


@pytest.fixture
def here(monkeypatch) -> None:
    """Trials of campaigns run in this process."""
    monkeypatch.setattr("sim.campaign.campaign.make_engine", EngineHere)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_a_run_holds_both_classes(run) -> None:
    summary, rows = json.loads((run / "summary.json").read_text()), rows_of(run / "steps.csv")
    assert summary["target_name"] == "cysts"
    assert summary["target_n_bodies"] == 2
    assert float(rows[-1]["target_auprc"]) == pytest.approx(summary["target_auprc"])
    assert float(rows[-1]["target_sensed_fraction"]) == pytest.approx(summary["target_sensed_fraction"])
    with np.load(run / "map.npz") as arrays:
        inside, probability = arrays["is_inside"], arrays["target_probability"]
        truth, tumour = arrays["is_target"], arrays["is_tumour"]
        auprc = average_precision(probability[inside], truth[inside])
    assert auprc == pytest.approx(
        summary["target_auprc"], abs=0.01
    )  # floats of 32 bits tie where scores do not
    assert truth.any()
    assert not (truth & tumour).any()
    labels = np.asarray(nibabel.load(run / "map_target_labels.nii.gz").dataobj)
    assert np.array_equal(labels == 3, np.nan_to_num(probability) > 0.5)
    assert (labels == 3).any()
    assert set(np.unique(labels)) == {0, 1, 3, 4}
    assert set(np.unique(np.asarray(nibabel.load(run / "map_labels.nii.gz").dataobj))) <= {0, 1, 2, 4}


def test_its_findings_stand_in_tables_of_their_own(run) -> None:
    (first, second), tumours = rows_of(run / "targets.csv"), rows_of(run / "tumours.csv")
    assert len(tumours) == 1
    assert next(iter(first)) == "target"
    assert [name.replace("tumour", "target") for name in tumours[0]] == list(first)
    for row, (_, radius_mm) in zip((first, second), CYSTS_MM, strict=True):
        ball_m3 = 4 / 3 * np.pi * (radius_mm * 1e-3) ** 3
        assert float(row["true_volume_m3"]) == pytest.approx(ball_m3, rel=0.03)  # of 1,280 triangles
    assert first["is_found"] == "1"
    assert float(first["mapped_volume_m3"]) == pytest.approx(float(first["true_volume_m3"]), rel=0.5)
    surface = trimesh.load(run / "surfaces" / "mapped_target_1.stl")
    assert np.linalg.norm(surface.bounds.mean(axis=0) - CYSTS_MM[0][0]) < 5.0
    told = json.loads((run / "findings.json").read_text())["target"]
    assert told["n_targets"] == 2
    assert told["n_targets_found"] == sum(row["is_found"] == "1" for row in (first, second))


def test_planted_findings_of_both_classes_come_back(tmp_path) -> None:
    tumour, cyst = ((0.03, 0.0, 0.0), 0.012), ((-0.03, 0.0, 0.01), 0.009)
    record = planted_run(tmp_path, true=[tumour], mapped=[tumour])
    own = planted_run(tmp_path, true=[cyst], mapped=[cyst, ((0.0, 0.05, 0.0), 0.008)])
    findings = findings_of(dataclasses.replace(record, target=own))
    assert (findings.n_found, len(findings.false)) == (1, 0)
    assert (findings.target.n_found, len(findings.target.false)) == (1, 1)
    assert findings.target.tumours[0].overlap.dice > 0.9
    write_finding_tables(tmp_path, findings)
    (false,) = rows_of(tmp_path / "target_false_findings.csv")
    assert float(false["target_distance_m"]) > 0.0
    assert finding_summary(findings)["target"]["n_false_findings"] == 1
    assert "target" not in finding_summary(findings_of(record))


def test_a_folder_read_back_knows_the_second_class(run) -> None:
    record = load_run(run)
    assert record.target.anatomy.name == "cysts"
    assert len(record.target.anatomy.tumours) == 2
    assert record.target.numbers("auprc")[-1] == float(rows_of(run / "steps.csv")[-1]["target_auprc"])
    last = record.target.history[N_ACTIONS]
    field = record.target.field
    np.testing.assert_allclose(last, np.clip(field.log_odds[field.is_inside], -6.35, 6.35), atol=0.03)
    scene = read_recording(run).scene
    assert [scene.model.geom(f"target{i}").group for i in range(2)] == [1, 1]


def test_the_report_shows_it_and_a_killed_run_has_one_too(run, tmp_path) -> None:
    text = (run / "report.html").read_text(encoding="utf-8")
    assert "AUPRC of the map of cysts" in text
    assert "<h2>Cysts</h2>" in text
    assert "cysts found" in text
    data = json.loads(text.split('id="data">')[1].split("</script>")[0])
    assert data["view"]["target"]["name"] == "cysts"
    assert len(data["view"]["target"]["bodies"]) == 2
    assert len(data["view"]["target"]["map"]["maps"]) == len(data["view"]["map"]["maps"])
    killed = tmp_path / "killed"
    killed.mkdir()
    for name in ("config.json", "manifest.json", "anatomy.npz", "steps.csv", "skipped.csv", "poses.csv"):
        if (run / name).exists():
            (killed / name).write_bytes((run / name).read_bytes())
    assert "<h2>Cysts</h2>" in write_report(killed).read_text(encoding="utf-8")


def test_export_writes_both_maps_again(run, tmp_path) -> None:
    assert main(["export", str(run), "--out", str(tmp_path)]) == 0
    written = sorted(file.name for file in tmp_path.iterdir())
    assert written == sorted(file.name for file in run.glob("*.nii.gz"))
    assert len(written) == 6
    for name in written:
        assert (tmp_path / name).read_bytes() == (run / name).read_bytes()


def test_a_run_without_it_leaves_nothing_of_it(case, run, tmp_path) -> None:
    out = shutil.copytree(run, tmp_path / "run")
    alone = case.parent / "alone.toml"
    alone.write_text("".join(line for line in case.read_text().splitlines(True) if "target" not in line))
    arguments = ["--scenario", str(alone), "--planner", "random", "--steps", "1", "--arm", "none"]
    assert main(["episode", *arguments, "--no-report", "--overwrite", "--out", str(out)]) == 0
    assert not list(out.rglob("*target*"))
    assert not [name for name in rows_of(out / "steps.csv")[0] if "target" in name]
    assert not [name for name in json.loads((out / "summary.json").read_text()) if "target" in name]
    with np.load(out / "map.npz") as arrays:
        assert not [name for name in arrays.files if "target" in name]


def test_a_trial_has_its_scores_in_the_row(case) -> None:
    result = run_trial(Trial(options(case, planner="random", map="when-needed")))
    assert result.row["status"] == "finished", result.row
    assert 0.0 <= result.row["target_sensed_fraction"] <= 1.0
    assert "target_auprc" not in result.row


def test_distances_of_structures_to_it_stand_in_rows_that_name_it(case, no_figures, tmp_path) -> None:
    """A ball before the organ, 4 mm of it away: all distances are those between balls."""
    vessel_mm, radius_mm = CENTRE_MM + np.array([0.0, -RADIUS_MM - 10.0, 0.0]), 6.0
    vessel = trimesh.creation.icosphere(subdivisions=3, radius=radius_mm)
    vessel.apply_translation(vessel_mm)
    vessel.export(tmp_path / "vessel.stl")
    shown = case.with_name("with_vessel.toml")
    shown.write_text(case.read_text() + f'structure_files = ["{tmp_path / "vessel.stl"}"]\n')
    arguments = ["--scenario", str(shown), "--steps", "2", "--seed", "2", "--arm", "none", "--no-report"]
    assert main(["episode", *arguments, "--plan-for", "target", "--out", str(tmp_path / "run")]) == 0
    rows = rows_of(tmp_path / "run" / "structures.csv")
    tumours, cysts = [row for row in rows if row["tumour"]], [row for row in rows if row["target"]]
    assert len(tumours) + len(cysts) == len(rows)
    assert {row["target_name"] for row in tumours} == {""}
    assert {row["target_name"] for row in cysts} == {"cysts"}
    for true, (centre_mm, cyst_mm) in zip(
        [row for row in cysts if row["target"] == "true"], CYSTS_MM, strict=True
    ):
        gap_mm = np.linalg.norm(vessel_mm - centre_mm) - radius_mm - cyst_mm
        assert float(true["distance_m"]) * 1e3 == pytest.approx(gap_mm, abs=0.3)  # a facet's sagitta
    mapped = [float(row["distance_m"]) for row in cysts if row["target"] == "mapped"]
    assert mapped  # two actions see one of them at least
    assert all(0.0 < each < 0.1 for each in mapped)


def test_the_figures_show_it(run) -> None:
    assert {file.name for file in run.glob("*.png")} == {
        *("auprc.png", "precision_recall.png", "map_top.png", "map_side.png"),
        *("map_target_top.png", "map_target_side.png"),
    }
    assert (run / "map_target_top.png").read_bytes() != (run / "map_top.png").read_bytes()
    for name, colours in (("auprc.png", (PURPLE, AMBER)), ("precision_recall.png", (AMBER,))):
        image = np.asarray(Image.open(run / name).convert("RGB")).astype(int)
        for colour in (*colours, BLUE):
            of = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
            assert (np.abs(image - of).max(axis=-1) <= 12).mean() > 1e-3, (name, colour)


def test_figures_of_an_organ_without_tumours_still_show_it(tmp_path) -> None:
    cysts = TargetCurves(
        name="cysts", auprc=[0.2, 0.8], sensed_fraction=[0.4, 0.9], recall=[0, 1], precision=[1, 0.4]
    )
    nothing = [np.nan, np.nan]
    draw_progress(tmp_path / "auprc.png", auprc=nothing, sensed_fraction=nothing, target=cysts)
    draw_precision_recall(
        tmp_path / "curve.png", recall=(), precision=(), auprc=None, prevalence=0.0, target=cysts
    )
    for name in ("auprc.png", "curve.png"):
        image = np.asarray(Image.open(tmp_path / name).convert("RGB")).astype(int)
        assert (np.abs(image - (0xE6, 0x9F, 0x00)).max(axis=-1) <= 12).mean() > 1e-3


def test_a_campaign_keeps_its_curves_beside_rows_without_it(case, here, tmp_path) -> None:
    alone = case.with_name("alone_in_campaign.toml")
    alone.write_text("".join(line for line in case.read_text().splitlines(True) if "target" not in line))
    study = tmp_path / "study.toml"
    study.write_text(
        f'[episode]\narm = "none"\nmotion = "none"\nmap-detail = "off"\nsteps = 2\n'
        f'[axes]\nscenario = ["{alone}", "{case}"]\nplanner = ["random"]\nseed = [3]\n'
    )
    assert main(["trials", "--study", str(study), "--jobs", "1", "--out", str(tmp_path / "both")]) == 0
    rows = rows_of(tmp_path / "both" / "trials.csv")
    with np.load(tmp_path / "both" / "curves.npz") as file:
        curves = dict(file)
    assert curves["count"].tolist() == [2, 2]
    without, having = (
        slice(first, first + n) for first, n in zip(curves["first"], curves["count"], strict=True)
    )
    for name in ("target_auprc", "target_sensed_fraction"):
        assert np.isnan(curves[name][without]).all()
        assert curves[name][having][-1] == pytest.approx(float(rows[1][name]), abs=1e-5)
    assert np.isnan(curves["target_precision"][0]).all()
    assert curves["target_precision"].shape == curves["precision"].shape
    # The area under the curve is between those of its steps at 50 levels of recall.
    levels = curves["target_precision"][1]
    assert abs(levels.mean() - float(rows[1]["target_auprc"])) < 0.02 + 1e-3
    bodies = rows_of(tmp_path / "both" / "targets.csv")
    assert [(row["scenario"], row["body"]) for row in bodies] == [(str(case), "1"), (str(case), "2")]
    assert rows[0]["target_n_lesions"] == ""
    assert int(rows[1]["target_n_lesions_found"]) == sum(row["is_found"] == "1" for row in bodies)
    assert len(rows_of(tmp_path / "both" / "lesions.csv")) == int(rows[0]["n_lesions"]) + int(
        rows[1]["n_lesions"]
    )


def test_a_campaign_of_tumours_alone_has_no_curves_of_it() -> None:
    entry = {"curves": {"sensed_fraction": [0.5], "auprc": [0.25], "precision": [0.1] * 50}}
    assert set(curve_arrays(iter([entry]))) == {
        *("first", "count", "auprc", "sensed_fraction", "precision", "recall")
    }


def test_a_campaign_notices_another_file_of_it(case, here, tmp_path, capsys) -> None:
    for file in case.parent.glob("*.stl"):
        shutil.copy(file, tmp_path)
    scenario = Path(shutil.copy(case, tmp_path))
    trials = ["trials", "--scenario", str(scenario), "--planner", "random", "--arm", "none", "--seeds", "0:1"]
    trials += ["--steps", "1", "--map", "when-needed", "--jobs", "1", "--out", str(tmp_path / "campaign")]
    assert main(trials) == 0
    shutil.copy(tmp_path / "cyst_2.stl", tmp_path / "cyst_1.stl")
    assert main(trials) == 2
    assert "begun with another file" in capsys.readouterr().err

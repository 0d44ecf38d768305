"""A second class of targets: sensed, mapped and told beside the tumours, which know nothing of it."""

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
from PIL import Image
from planted_run import planted_run
from scanned_ball import CENTRE_MM, RADIUS_MM
from two_classes import CYSTS_MM, write_labels, write_meshes

from mapping import HilbertMap, average_precision
from planner import Workspace
from sim.carrier import FreeCarrier
from sim.cli import main
from sim.episode import Episode
from sim.errors import UsageError
from sim.figures import AMBER, BLUE, PURPLE, TargetCurves, draw_precision_recall, draw_progress
from sim.finding_tables import finding_summary, write_finding_tables
from sim.findings import find
from sim.options import EpisodeOptions
from sim.replay import read_recording
from sim.report import write_report
from sim.run import make_episode
from sim.run_figures import draw_run_figures
from sim.run_record import read_run
from sim.scenarios import Scenario, load_scenario
from sim.stage import Stage, build_stage, placed_organ
from sim.trial import run_trial
from sim.trial_tables import curve_arrays
from sim.world.anatomy_files import AnatomyFiles, load_anatomy
from sim.world.errors import VolumeError
from sim.world.label_coding import LabelChoice
from sim.world.probe import Probe
from sim.world.scene import build_scene

N_ACTIONS = 4
LABELS = ("--organ-label", "1", "--tumour-label", "2")


def options(scenario: Path, **changes) -> EpisodeOptions:
    """Of a quick episode."""
    quick: dict = {"arm": "none", "motion": "none", "steps": N_ACTIONS, "seed": 2, "map_insets": "off"}
    return EpisodeOptions(scenario=str(scenario), **(quick | changes))


def sensed(asked: EpisodeOptions, stage: Stage) -> tuple[Episode, list]:
    """An episode after its steps, and these."""
    episode = make_episode(asked, stage)
    return episode, list(episode.steps(N_ACTIONS))


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Path:
    return write_meshes(tmp_path_factory.mktemp("two"))


@pytest.fixture(scope="module")
def stage(case) -> Stage:
    asked = options(case)
    return build_stage(asked.make_scenario(), None, asked.make_map_settings())


@pytest.fixture(scope="module")
def both(case, stage):
    return sensed(options(case), stage)


@pytest.fixture(scope="module")
def run(case) -> Path:
    """A run's folder."""
    out = case.parent / "run"
    arguments = ["--scenario", str(case), "--steps", str(N_ACTIONS), "--seed", "2", "--arm", "none"]
    assert main(["episode", *arguments, "--plan-for", "target", "--frames", "last", "--out", str(out)]) == 0
    return out


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_readings_label_each_class_as_an_independent_inside_test_does(both) -> None:
    episode, steps = both
    classes = {"is_occupied": episode.truth.anatomy, "is_target": episode.truth.anatomy.target}
    for name, anatomy in classes.items():
        n_inside = 0
        for step in steps:
            inside = np.zeros(len(step.reading.points_m), dtype=bool)
            for solid in anatomy.tumours:
                inside |= trimesh.Trimesh(solid.vertices_m, solid.faces).contains(step.reading.points_m)
            assert np.array_equal(getattr(step.reading, name), inside)
            n_inside += inside.sum()
        assert n_inside > 20


def test_rays_ask_for_one_class_where_bodies_overlap(ball_anatomy, cone) -> None:
    # The second class is the tumours themselves: nested, overlapping, and everywhere the same as they are.
    both = reading_in(dataclasses.replace(ball_anatomy, target=ball_anatomy), cone)
    assert np.array_equal(both.is_target, both.is_occupied)
    assert both.is_occupied.any()
    alone = reading_in(dataclasses.replace(ball_anatomy, tumours=(), target=ball_anatomy), cone)
    assert np.array_equal(alone.points_m, both.points_m)
    assert np.array_equal(alone.is_target, both.is_target)
    assert not alone.is_occupied.any()


def reading_in(anatomy, cone):
    """What the probe reads from above the middle of the ball."""
    scene = build_scene(anatomy, cone, arm=None)
    above = Workspace(np.array([[0.5, 0.0, 0.12]]), np.array([[0.0, 0.0, -1.0]]))
    data = scene.new_data()
    FreeCarrier(scene, above).place(data, 0, is_lifted=False)
    return Probe(scene).sense(data, np.random.default_rng(0))


def test_the_tumours_know_nothing_of_it(case, stage, both) -> None:
    episode, steps = sensed(options(case), dataclasses.replace(stage, given_targets=(), target_names=()))
    assert episode.target is None
    assert steps[-1].target is None
    assert steps[-1].reading.is_target is None
    for one, other in zip(steps, both[1], strict=True):
        assert (one.pose_index, one.auprc, one.sensed_fraction) == (
            other.pose_index,
            other.auprc,
            other.sensed_fraction,
        )
        assert np.array_equal(one.reading.points_m, other.reading.points_m)
    assert episode.prediction.latent_mean.tobytes() == both[0].prediction.latent_mean.tobytes()
    assert episode.prediction.latent_variance.tobytes() == both[0].prediction.latent_variance.tobytes()


def test_its_map_is_the_one_that_learns_its_labels_alone(case, stage) -> None:
    asked = options(case)
    episode, steps = sensed(asked, stage)
    own = HilbertMap(
        stage.hinges,
        asked.make_map_settings(),
        query=stage.query,
        query_mask=stage.is_inside,
        hinge_mask=stage.hinge_mask,
    )
    for step in steps:
        own.update(step.reading.points_m, step.reading.is_target)
    expected = own.predict_lattice()
    assert episode.target.prediction.latent_mean.tobytes() == expected.latent_mean.tobytes()
    inside = np.zeros(len(stage.search_points_m), dtype=bool)
    for solid in episode.truth.anatomy.target.tumours:
        inside |= solid.contains(stage.search_points_m)
    assert steps[-1].target.auprc == average_precision(expected.score, inside)


def test_classes_that_change_places_change_maps(case, stage) -> None:
    """Planning for the targets is planning for tumours in their place."""
    changed = dataclasses.replace(
        stage,
        given_tumours=stage.given_targets,
        tumour_names=stage.target_names,
        given_targets=stage.given_tumours,
        target_names=stage.tumour_names,
    )
    for_target, steps = sensed(options(case, plan_for="target"), stage)
    for_tumours, others = sensed(options(case), changed)
    assert [step.pose_index for step in steps] == [step.pose_index for step in others]
    target = for_target.target.prediction
    assert target.latent_mean.tobytes() == for_tumours.prediction.latent_mean.tobytes()
    assert for_target.prediction.latent_mean.tobytes() == for_tumours.target.prediction.latent_mean.tobytes()
    assert target.probability[for_target.target.truth.is_target].mean() > 0.4  # of a prior of 2 %


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
    assert set(np.unique(labels)) == {0, 1, 3}
    assert set(np.unique(np.asarray(nibabel.load(run / "map_labels.nii.gz").dataobj))) <= {0, 1, 2}


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
    findings = find(dataclasses.replace(record, target=own))
    assert (findings.n_found, len(findings.false)) == (1, 0)
    assert (findings.target.n_found, len(findings.target.false)) == (1, 1)
    assert findings.target.tumours[0].overlap.dice > 0.9
    write_finding_tables(tmp_path, findings)
    (false,) = rows_of(tmp_path / "target_false_findings.csv")
    assert float(false["target_distance_m"]) > 0.0
    assert finding_summary(findings)["target"]["n_false_findings"] == 1
    assert "target" not in finding_summary(find(record))


def test_a_folder_read_back_knows_the_second_class(run) -> None:
    record = read_run(run)
    assert record.target.anatomy.name == "cysts"
    assert len(record.target.anatomy.tumours) == 2
    assert record.target.numbers("auprc")[-1] == float(rows_of(run / "steps.csv")[-1]["target_auprc"])
    last = record.target.history[N_ACTIONS]
    field = record.target.field
    np.testing.assert_allclose(last, np.clip(field.log_odds[field.is_inside], -6.35, 6.35), atol=0.03)
    scene = read_recording(run).scene
    assert [scene.model.geom(f"target{i}").group for i in range(2)] == [1, 1]


def test_the_report_shows_it_and_a_killed_run_has_one_too(run) -> None:
    text = (run / "report.html").read_text(encoding="utf-8")
    assert "AUPRC of the map of cysts" in text
    assert "<h2>Cysts</h2>" in text
    assert "cysts found" in text
    data = json.loads(text.split('id="data">')[1].split("</script>")[0])
    assert data["view"]["target"]["name"] == "cysts"
    assert len(data["view"]["target"]["bodies"]) == 2
    assert len(data["view"]["target"]["map"]["maps"]) == len(data["view"]["map"]["maps"])
    killed = run.parent / "killed"
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
    arguments = ["--scenario", str(alone), "--steps", "1", "--arm", "none", "--out", str(out)]
    assert main(["episode", *arguments, "--no-report", "--overwrite"]) == 0
    assert not list(out.rglob("*target*"))
    assert not [name for name in rows_of(out / "steps.csv")[0] if "target" in name]
    assert not [name for name in json.loads((out / "summary.json").read_text()) if "target" in name]
    with np.load(out / "map.npz") as arrays:
        assert not [name for name in arrays.files if "target" in name]


def test_a_trial_has_its_scores_in_the_row(case) -> None:
    result = run_trial(options(case, planner="random", map="when-needed"))
    assert result.row["status"] == "finished", result.row
    assert 0.0 <= result.row["target_sensed_fraction"] <= 1.0
    assert "target_auprc" not in result.row


def test_distances_of_structures_to_it_stand_in_rows_that_name_it(case, tmp_path) -> None:
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


def test_the_figures_show_it(run, both, tmp_path) -> None:
    episode, steps = both
    draw_run_figures(tmp_path, episode, steps)
    names = {file.name for file in tmp_path.glob("*.png")}
    assert names == {file.name for file in run.glob("*.png")}
    assert {"map_target_top.png", "map_target_side.png"} < names
    assert (tmp_path / "map_target_top.png").read_bytes() != (tmp_path / "map_top.png").read_bytes()
    for name, colours in (("auprc.png", (PURPLE, AMBER)), ("precision_recall.png", (AMBER,))):
        image = np.asarray(Image.open(tmp_path / name).convert("RGB")).astype(int)
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


def test_a_campaign_keeps_its_curves_beside_rows_without_it(case, tmp_path) -> None:
    alone = case.with_name("alone_in_campaign.toml")
    alone.write_text("".join(line for line in case.read_text().splitlines(True) if "target" not in line))
    study = tmp_path / "study.toml"
    study.write_text(
        f'[episode]\narm = "none"\nmotion = "none"\nmap-insets = "off"\nsteps = 2\n'
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


def test_a_campaign_of_tumours_alone_has_no_curves_of_it() -> None:
    entry = {"curves": {"sensed_fraction": [0.5], "auprc": [0.25], "precision": [0.1] * 50}}
    assert set(curve_arrays(iter([entry]))) == {
        *("first", "count", "auprc", "sensed_fraction", "precision", "recall")
    }


def test_a_campaign_notices_another_file_of_it(case, tmp_path, capsys) -> None:
    for file in case.parent.glob("*.stl"):
        shutil.copy(file, tmp_path)
    scenario = Path(shutil.copy(case, tmp_path))
    trials = ["trials", "--scenario", str(scenario), "--planner", "random", "--arm", "none", "--seeds", "0:1"]
    trials += ["--steps", "1", "--map", "when-needed", "--jobs", "1", "--out", str(tmp_path / "campaign")]
    assert main(trials) == 0
    shutil.copy(tmp_path / "cyst_2.stl", tmp_path / "cyst_1.stl")
    assert main(trials) == 2
    assert "begun with another file" in capsys.readouterr().err


def test_a_label_is_the_second_class_and_belongs_to_the_organ(tmp_path) -> None:
    path = write_labels(tmp_path)
    asked = LabelChoice(organ=(1,), tumours=(2,), targets=(3,))
    loaded = load_anatomy(AnatomyFiles(organ=str(path), labels=asked))
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * (RADIUS_MM * 1e-3) ** 3, rel=0.02)
    assert [name.split(": ")[1] for name in loaded.target_names] == ["target 1", "target 2"]
    for solid, (centre_mm, _) in zip(loaded.targets, CYSTS_MM, strict=True):
        assert solid.bounds_m.mean(axis=0) * 1e3 == pytest.approx(centre_mm, abs=1.0)
    as_file = load_anatomy(AnatomyFiles(organ=str(path), labels=asked, targets=(str(path),)))
    assert len(as_file.targets) == 4
    for labels, said in (((2,), "means tumours already"), ((1,), "means the whole organ already")):
        with pytest.raises(VolumeError, match=said):
            load_anatomy(AnatomyFiles(organ=str(path), labels=dataclasses.replace(asked, targets=labels)))


def test_the_target_moves_with_the_organ(case) -> None:
    scenario = dataclasses.replace(load_scenario(str(case)), organ_turn_rad=(0.3, -0.2, 0.9))
    placed, _ = placed_organ(scenario)
    middle_m = placed.T_world_organ @ [*(np.array(CYSTS_MM[0][0]) * 1e-3), 1.0]
    assert placed.targets[0].bounds_m.mean(axis=0) == pytest.approx(middle_m[:3], abs=2e-4)


@pytest.fixture(scope="module")
def bad_files(case, tmp_path_factory) -> dict[str, Path]:
    """Files that the refused command lines below name."""
    folder = tmp_path_factory.mktemp("bad")
    far = trimesh.creation.icosphere(radius=8.0)
    far.export(folder / "far.stl")
    image = nibabel.load(write_labels(folder))
    labels = np.asarray(image.dataobj).copy()
    dust = np.argwhere(labels == 3)[0]
    labels[labels == 3] = 1
    labels[tuple(dust)] = 3
    spacing = image.affine.copy()
    spacing[:3, :3] /= 3.0  # voxels of 1 mm, of which one is noise
    nibabel.save(nibabel.Nifti1Image(labels, spacing), folder / "dust.nii.gz")
    return {
        "organ": case.parent / "organ.stl",
        "cyst": case.parent / "cyst_1.stl",
        "far": folder / "far.stl",
        "labels": folder / "case.nii.gz",
        "dust": folder / "dust.nii.gz",
    }


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--target", "{cyst}"], "--target goes with --organ"),
        (["--target-name", "cysts"], "names nothing"),
        (["--plan-for", "target"], "--plan-for target: there is none"),
        (["--organ", "{organ}", "--target-label", "3"], "targets as --target FILE"),
        (["--organ", "{organ}", "--target", "{cyst}", "--target-name", " "], "a name of 1 to 40 letters"),
        (["--organ", "{organ}", "--target", "{far}"], "far.stl: only 0% of it lies inside the organ"),
        (["--organ", "{organ}", "--target", "absent.stl"], "absent.stl: "),
        (["--organ", "{labels}", *LABELS, "--target-label", "7"], "--target-label 7 is not in the file"),
        (["--organ", "{dust}", *LABELS, "--target-label", "3"], "nothing is left of the target class"),
    ],
)
def test_what_cannot_be_is_refused_with_the_remedy(bad_files, tmp_path, capsys, flags, said) -> None:
    asked = [flag.format(**bad_files) for flag in flags]
    assert main(["episode", *asked, "--arm", "none", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error


def test_a_class_that_is_not_there_is_refused(stage) -> None:
    with pytest.raises(UsageError, match="go with an organ's own file"):
        Scenario(target_files=("cyst.stl",))
    planner, alone = EpisodeOptions().make_planner(), dataclasses.replace(stage, given_targets=())
    with pytest.raises(ValueError, match="no second class"):
        Episode(alone, planner, seed=0, plans_for_target=True)


def test_inspect_counts_the_targets(tmp_path, capsys) -> None:
    path = write_labels(tmp_path)
    picture = ["--out", str(tmp_path / "case.png")]
    assert main(["inspect", str(path), *LABELS, "--target-label", "3", *picture]) == 0
    assert "targets: 2, " in capsys.readouterr().out

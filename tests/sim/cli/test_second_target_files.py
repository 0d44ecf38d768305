"""Where a second class of targets comes from: meshes, labels, and what is refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import nibabel
import numpy as np
import pytest
import trimesh
from scanned_ball import RADIUS_MM
from two_classes import CYSTS_MM, write_labels, write_meshes

from sim.cli.command_line import main
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import placed_organ
from sim.world.anatomy.case_files import CaseFiles
from sim.world.anatomy.loading import load_anatomy
from sim.world.errors import VolumeError
from sim.world.volumes.label_coding import LabelChoice

LABELS = ("--organ-label", "1", "--tumour-label", "2")


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Path:
    return write_meshes(tmp_path_factory.mktemp("two"))


def test_a_label_is_the_second_class_and_belongs_to_the_organ(tmp_path) -> None:
    path = write_labels(tmp_path)
    asked = LabelChoice(organ=(1,), tumours=(2,), targets=(3,))
    loaded = load_anatomy(CaseFiles(organ=str(path), labels=asked))
    assert loaded.organ.volume_m3 == pytest.approx(4 / 3 * np.pi * (RADIUS_MM * 1e-3) ** 3, rel=0.02)
    assert [name.split(": ")[1] for name in loaded.target_names] == ["target 1", "target 2"]
    for solid, (centre_mm, _) in zip(loaded.targets, CYSTS_MM, strict=True):
        assert solid.bounds_m.mean(axis=0) * 1e3 == pytest.approx(centre_mm, abs=1.0)
    as_file = load_anatomy(CaseFiles(organ=str(path), labels=asked, targets=(str(path),)))
    assert len(as_file.targets) == 4
    for labels, said in (((2,), "means tumours already"), ((1,), "means the whole organ already")):
        with pytest.raises(VolumeError, match=said):
            load_anatomy(CaseFiles(organ=str(path), labels=dataclasses.replace(asked, targets=labels)))


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
        (["--plan-for", "target"], "--plan-for target: there is no second class"),
        (["--organ", "{organ}", "--target-label", "3"], "targets as --target FILE"),
        (["--organ", "{organ}", "--target", "{cyst}", "--target-name", " "], "a name of 1 to 40 letters"),
        (["--organ", "{organ}", "--target", "{far}"], "far.stl: only 0% of it lies inside the organ"),
        (["--organ", "{organ}", "--target", "absent.stl"], "absent.stl: "),
        (["--organ", "{labels}", *LABELS, "--target-label", "7"], "--target-label 7 is not in the file"),
        (["--organ", "{dust}", *LABELS, "--target-label", "3"], "nothing is left of the target class"),
    ],
)
def test_what_cannot_be_is_refused_with_the_remedy(bad_files, coarse, tmp_path, capsys, flags, said) -> None:
    asked = ["--scenario", str(coarse), *(flag.format(**bad_files) for flag in flags)]
    assert main(["episode", *asked, "--arm", "none", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error


def test_inspect_counts_the_targets(no_figures, tmp_path, capsys) -> None:
    path = write_labels(tmp_path)
    picture = ["--out", str(tmp_path / "case.png")]
    assert main(["inspect", str(path), *LABELS, "--target-label", "3", *picture]) == 0
    assert "targets: 2, " in capsys.readouterr().out

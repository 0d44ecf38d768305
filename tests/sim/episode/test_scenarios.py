"""Scenario files: what they may say, and what is said of wrong ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.episode.scenario import SCENARIOS, Scenario
from sim.episode.scenario_file import load_scenario
from sim.errors import UsageError


def write(tmp_path: Path, text: str) -> str:
    path = tmp_path / "case.toml"
    path.write_text(text)
    return str(path)


def test_the_paper_is_kept_by_name() -> None:
    sphere = load_scenario("sphere")
    assert (sphere.n_tumours, sphere.tumour_radius_m, sphere.cone_depth_m) == (
        1,
        pytest.approx(0.012),
        pytest.approx(0.102),
    )
    assert load_scenario("spheres").n_tumours == 3


def test_a_file_changes_what_it_names_and_keeps_the_rest(tmp_path) -> None:
    scenario = load_scenario(write(tmp_path, 'base = "spheres"\nn_tumours = 5\ncone_depth_m = 0.08\n'))
    assert (scenario.n_tumours, scenario.cone_depth_m, scenario.organ) == (
        5,
        0.08,
        SCENARIOS["spheres"].organ,
    )
    assert scenario.name == "case"


def test_mesh_paths_are_relative_to_the_file(tmp_path) -> None:
    scenario = load_scenario(write(tmp_path, 'organ = "organ.stl"\ntumour_files = ["a.stl"]\n'))
    files = scenario.case_files
    assert files is not None
    assert (files.organ, files.tumours) == (str(tmp_path / "organ.stl"), (str(tmp_path / "a.stl"),))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("depth = 3", "unknown key 'depth'.*cone_depth_m"),
        ('base = "kidney"', "'kidney'.*sphere, spheres, liver"),
        ("n_tumours = -1", "n_tumours=-1"),
        ("n_tumours = 1.5", "n_tumours=1.5.*whole number"),
        ('cone_depth_m = "deep"', "cone_depth_m='deep'.*number"),
        ("cone_depth_m = nan", "cone_depth_m=nan"),
        ("cone_half_angle_rad = 2.0", "half-angle 115 degrees"),
        ("organ_position_m = [0.0, 0.0, 0.0]", "belong together"),
        ("organ_unit = 'cm'", "organ_unit='cm'"),
        ("n_tumours = ", "not a valid TOML"),
        ('tumour_files = ["a.stl"]', "tumour_files: go with an organ's own file, not with organ='liver'"),
        ('base = "sphere"\nkeepout_labels = [3]', "keepout_labels: go with.*organ='paper-organ'"),
    ],
)
def test_a_wrong_file_is_named_with_the_remedy(tmp_path, text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        load_scenario(write(tmp_path, text))
    assert "case.toml" in str(caught.value)


def test_unknown_names_and_missing_files_are_named(tmp_path) -> None:
    with pytest.raises(UsageError, match="'kidney': not one of sphere, spheres, liver"):
        load_scenario("kidney")
    with pytest.raises(UsageError, match="nowhere.toml: cannot read"):
        load_scenario(str(tmp_path / "nowhere.toml"))


def test_ranges_hold_in_code_too() -> None:
    with pytest.raises(UsageError, match="score_spacing_m=0.0001"):
        Scenario(score_spacing_m=0.0001)

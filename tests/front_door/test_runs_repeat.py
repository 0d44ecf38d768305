"""A run's config.json is enough to run it again, to the byte; options that are given beside it take precedence."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from campaign_plugs import lay_out

import sounding
from sim.cli.command_line import main, parse_command
from sim.cli.terminal import given_word
from sim.episode.measures import ACTION_SECONDS
from sim.errors import UsageError
from sim.running.fields import default_of, field_names, flat, recorded

BEFORE_GROUPS = {
    **{
        "scenario": "ball.toml",
        "planner": "random",
        "steps": 2,
        "until_sensed": None,
        "until_confident": None,
    },
    **{"seed": 3, "arm": "none", "flange": None, "base_mm": [0.0, 0.0, 0.0], "base_yaw_deg": 0.0},
    **{"motion": "kinematic", "joint_speed": None, "joint_acceleration": None, "tip_speed_mm_s": 250.0},
    **{
        "approach_speed_mm_s": 50.0,
        "press_mm": 2.0,
        "stiffness_n_m": None,
        "force_limit_n": 5.0,
        "sensing_s": 2.0,
    },
    **{"organ": None, "tumour": [], "n_tumours": None, "unit": "mm", "mesh_frame": "auto", "coding": "auto"},
    **{"organ_label": [], "tumour_label": [], "target": [], "target_label": [], "target_name": None},
    **{"plan_for": "tumours", "structure": [], "structure_label": [], "keepout": [], "keepout_label": []},
    **{"keepout_mm": 5.0, "spacing_mm": None, "organ_pose": [], "frames": "none", "report": False},
    **{
        "out": "run-ball",
        "overwrite": False,
        "cone_half_angle_deg": None,
        "cone_depth_mm": None,
        "map": "always",
    },
    **{"map_form": "full", "map_settings": None, "map_detail": None, "prior_prevalence": None},
    **{
        "weight_variance": None,
        "em_iterations": None,
        "travel_weight": 0.0,
        "batch": 1,
        "sure_radius_mm": 8.0,
    },
    **{"ei_values": "latent", "ei_pose_rule": "best-aligned", "ei_threshold_deg": 5.0},
    **{"ei_exclusion_share": 0.28, "ei_reuse_poses": False},
}
"""The options of a config.json that was written before there were sensors and maps to choose."""


@pytest.fixture(scope="module")
def user(tmp_path_factory) -> Path:
    """The folder of a user, with a ball, a patient's meshes and plugs; also where Python finds modules."""
    folder = tmp_path_factory.mktemp("user")
    lay_out(folder)
    organ = trimesh.creation.icosphere(subdivisions=3, radius=40.0)
    tumour = trimesh.creation.icosphere(subdivisions=3, radius=9.0).apply_translation((5.0, -12.0, 8.0))
    (folder / "meshes").mkdir()
    organ.export(folder / "meshes" / "organ.stl")
    tumour.export(folder / "meshes" / "tumour.stl")
    before = set(sys.modules)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path, str(folder)])
        # Figures take most of the time of so short a run, and nothing here looks at them.
        patch.setattr("sim.pictures.run_figures.draw_run_figures", lambda *_: None)
        yield folder
    for name in set(sys.modules) - before:
        if str(folder) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


@pytest.fixture
def elsewhere(tmp_path, user, monkeypatch) -> Path:
    """Another folder, from which a run is repeated; the test begins in the user's."""
    monkeypatch.chdir(user)
    return tmp_path


def untimed(folder: Path) -> list[dict[str, str]]:
    """The rows of steps.csv without what was measured."""
    rows = list(csv.DictReader((folder / "steps.csv").open()))
    assert rows
    assert set(ACTION_SECONDS) <= set(rows[0])
    return [{name: cell for name, cell in row.items() if name not in ACTION_SECONDS} for row in rows]


def configuration(folder: Path) -> dict:
    """What config.json holds, but for the scenario's record of its files, whose paths are as they were given."""
    config = json.loads((folder / "config.json").read_text())
    for name in ("organ", "files"):
        del config["scenario"][name]
    return config


def assert_same_run(folder: Path, other: Path) -> None:
    assert configuration(folder) == configuration(other)
    assert untimed(folder) == untimed(other)
    for name in ("map.npz", "states.csv", "poses.csv", "findings.json", "map_probability.nii.gz"):
        assert (folder / name).read_bytes() == (other / name).read_bytes(), name


CASES = {
    "random planner on a scenario's file": "--scenario ball.toml --planner random --arm none --seed 4",
    "expected improvement with options": (
        "--scenario ball.toml --planner expected-improvement --ei-values probability --ei-reuse-poses --arm none "
        "--map-detail on --seed 1"
    ),
    "a patient with the arm": (
        "--organ meshes/organ.stl --tumour meshes/tumour.stl --organ-pose 10 0 5 --base-mm 0 20 0 --seed 2"
    ),
    "plugs with options": (
        "--scenario ball.toml --arm none --planner own_parts:Backwards --planner-option step=7 "
        "--sensor own_parts:Forgetful --sensor-option miss_rate=0.4 --map own_parts:Shares --map-option weight=0.5"
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_run_repeats_to_the_byte_from_another_folder(user, elsewhere, monkeypatch, capsys, case) -> None:
    first = user / "runs" / case.replace(" ", "-")
    words = [*CASES[case].split(), "--steps", "2", "--no-report", "--out", str(first)]
    assert main(["episode", *words]) == 0, capsys.readouterr().err
    monkeypatch.chdir(elsewhere)
    assert main(["episode", "--config", str(first / "config.json"), "--out", "again"]) == 0
    assert_same_run(first, elsewhere / "again")
    assert not (
        elsewhere / "again" / "report.html"
    ).exists()  # whether there is a report is an option like others


def test_options_on_the_line_take_precedence(user, elsewhere, capsys) -> None:
    words = ["--scenario", "ball.toml", "--arm", "none", "--no-report"]
    first = ["--planner", "random", "--map-form", "diagonal", "--steps", "4", "--seed", "1"]
    assert main(["episode", *words, *first, "--out", str(elsewhere / "first")]) == 0
    changes = ["--steps", "2", "--seed", "9", "--planner", "multi-resolution"]
    config = ["--config", str(elsewhere / "first" / "config.json")]
    assert main(["episode", *changes, *config, "--out", str(elsewhere / "changed")]) == 0
    plain = [*words, "--map-form", "diagonal", *changes]
    assert main(["episode", *plain, "--out", str(elsewhere / "plain")]) == 0
    assert_same_run(elsewhere / "changed", elsewhere / "plain")
    options = json.loads((elsewhere / "changed" / "config.json").read_text())["options"]
    assert (options["steps"], options["seed"], options["planner"]) == (2, 9, "multi-resolution")
    assert options["map_form"] == "diagonal"


def test_an_option_may_go_with_what_only_the_file_says(user, elsewhere) -> None:
    """A tumour goes with an organ, which the line does not name."""
    organ = ["--organ", "meshes/organ.stl", "--steps", "1"]
    config = recorded(parse_command(["episode", *organ]))
    (elsewhere / "config.json").write_text(json.dumps({"options": config}))
    line = ["--tumour", "meshes/tumour.stl", "--config", str(elsewhere / "config.json")]
    options = parse_command(["episode", *line])
    assert options.organ == user / "meshes" / "organ.stl"
    assert options.case.tumour == (Path("meshes/tumour.stl"),)


def test_a_word_is_found_however_it_is_written() -> None:
    assert given_word(["--steps", "3", "--config", "a.json"], "config") == "a.json"
    assert given_word(["--config=a=b.json", "--steps", "3"], "config") == "a=b.json"
    assert given_word(["--config", "--steps"], "config") is None  # the parser says what is missing
    assert given_word(["--config"], "config") is None
    assert given_word(["--map-settings", "paper"], "map") is None


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "cannot be read (No such file or directory). Name a run's config.json."),
        ("{", "is not JSON"),
        ("\xff\xfe", "is not JSON"),
        ("[1, 2]", "is not the config.json of an episode. Name one that a run wrote."),
        ('{"options": 3}', "is not the config.json of an episode. Name one that a run wrote."),
        # That of a reachability study, which has no planner.
        (
            '{"options": {"scenario": "liver", "arm": ["default"], "seed": 0}}',
            "is not the config.json of an episode.",
        ),
        (
            '{"options": {"scenario": "liver", "planner": "random", "seed": "x"}}',
            "seed='x': must be a whole number.",
        ),
        (
            '{"options": {"scenario": "liver", "planner": "random", "seed": 0, "zeal": 1}}',
            "unknown option 'zeal'.",
        ),
        (
            '{"options": {"scenario": "liver", "planner": "magic", "seed": 0}}',
            "planner=magic: choose one of ",
        ),
        (
            '{"options": {"scenario": "liver", "planner": "random", "seed": 0, "steps": 0}}',
            "steps=0: must be from 1 to 14400.",
        ),
    ],
)
def test_a_file_that_is_no_config_is_told_in_one_line(elsewhere, capsys, content, told) -> None:
    path = elsewhere / "config.json"
    if content is not None:
        path.write_text(content, encoding="latin-1")
    assert main(["episode", "--config", str(path), "--out", str(elsewhere / "run")]) == 2
    out, err = capsys.readouterr()
    (line,) = err.splitlines()
    assert out == ""
    assert line.startswith(f"sounding: {path}: {told}")
    assert not (elsewhere / "run").exists()


def test_a_config_from_before_there_were_sensors_to_choose_still_runs(user, elsewhere) -> None:
    (elsewhere / "config.json").write_text(json.dumps({"options": BEFORE_GROUPS}))
    assert main(["episode", "--config", str(elsewhere / "config.json"), "--out", str(elsewhere / "run")]) == 0
    options = json.loads((elsewhere / "run" / "config.json").read_text())["options"]
    assert options["scenario"] == str(user / "ball.toml")
    since = set(options) - set(BEFORE_GROUPS)
    assert {"sensor", "sensor_option", "planner_option", "map_option"} <= since
    assert {name: options[name] for name in since} == {name: default_of(name) for name in since}
    kept = set(BEFORE_GROUPS) - {"scenario", "out", "overwrite"}
    assert {name: options[name] for name in kept} == {name: BEFORE_GROUPS[name] for name in kept}


def test_a_configuration_is_recorded_without_loss() -> None:
    """All fields but those that say where a run comes from and goes to."""
    options = parse_command(["episode", "--scenario", "sphere", "--seed", "3", "--joint-speed", "0.5"])
    values = recorded(options)
    assert set(field_names()) - set(values) == {"config", "live", "out", "overwrite"}
    assert values == {name: value for name, value in flat(options).items() if name in values}


def test_a_run_with_objects_in_memory_repeats_by_their_texts_and_settings(
    user, elsewhere, monkeypatch
) -> None:
    from own_parts import Backwards, Forgetful, Shares  # pyright: ignore[reportMissingImports]

    options = {"arm": "none", "steps": 3, "report": False, "show_progress": False}
    sounding.run_episode(
        scenario="ball.toml",
        planner=Backwards(step=5),
        sensor=Forgetful(miss_rate=0.6),
        tumour_map=Shares,
        out=elsewhere / "first",
        **options,
    )
    config = json.loads((elsewhere / "first" / "config.json").read_text())["options"]
    assert (config["planner_option"], config["sensor_option"]) == (["step=5"], ["miss_rate=0.6"])
    monkeypatch.chdir(elsewhere)
    assert main(["episode", "--config", "first/config.json", "--out", "by-command"]) == 0
    assert_same_run(elsewhere / "first", elsewhere / "by-command")
    sounding.run_episode(config="first/config.json", out="by-call", show_progress=False)
    assert_same_run(elsewhere / "first", elsewhere / "by-call")
    other = sounding.run_episode(config="first/config.json", seed=8, out="other-seed", show_progress=False)
    assert other["seed"] == 8
    with np.load("by-call/own_map.npz") as mine, np.load("other-seed/own_map.npz") as others:
        assert mine["n_tumour"] != others["n_tumour"]


def test_a_call_tells_of_a_broken_config_too(tmp_path) -> None:
    with pytest.raises(UsageError, match=r"config\.json: cannot be read"):
        sounding.run_episode(config=tmp_path / "config.json")

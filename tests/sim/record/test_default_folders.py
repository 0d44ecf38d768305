"""Who names no folder gets one that says what ran, and never one that holds something else."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from sim.campaign.campaign_folder import CampaignFolder, can_hold
from sim.campaign.study import Part, Study
from sim.cli import inspection, reach
from sim.cli.command_line import parse_command
from sim.pictures.figures import Figure, save
from sim.reach.arm_comparison import folder_names
from sim.record.default_folders import default_folder, file_part
from sim.running.fields import config_of
from sim.running.output import output_of
from sim.running.parts import make_parts

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)


def folder_of(**options) -> Path:
    config = config_of(options)
    return output_of(config, make_parts(config), {"seed": 0}).folder


def test_the_name_of_an_episode_says_scenario_planner_arm_and_seed() -> None:
    assert folder_of() == Path("renders/liver-find-and-outline-0")
    assert folder_of(scenario="sphere", planner="random", arm="none", seed=3) == Path(
        "renders/sphere-random-none-3"
    )
    assert folder_of(out="here") == Path("here")
    assert [file_part(text) for text in ("a/b/panda.xml", "mine.py:Greedy", "x.nii.gz")] == [
        "panda",
        "Greedy",
        "x",
    ]


def test_a_number_is_appended_where_the_folder_holds_anything() -> None:
    options = {"steps": 3, "out": None}
    assert default_folder("run", options) == Path("renders/run")
    Path("renders/run").mkdir(parents=True)
    assert default_folder("run", options) == Path("renders/run")
    Path("renders/run/holiday.png").touch()
    Path("renders/run-2").touch()
    assert default_folder("run", options) == Path("renders/run-3")


def test_overwrite_takes_the_run_of_just_these_options() -> None:
    for name, steps in (("run", 3), ("run-2", 5)):
        folder = Path("renders") / name
        folder.mkdir(parents=True)
        (folder / "config.json").write_text(json.dumps({"options": {"steps": steps, "out": name}}))
    assert default_folder("run", {"steps": 5, "out": None}, overwrite=True) == Path("renders/run-2")
    assert default_folder("run", {"steps": 7, "out": None}, overwrite=True) == Path("renders/run-3")
    assert default_folder("run", {"steps": 5, "out": None}) == Path("renders/run-3")


def test_a_campaign_goes_on_in_its_folder_and_another_begins_in_its_own() -> None:
    small, other = (
        Study("trials", (Part({"scenario": ("sphere",), "planner": (name,), "seed": range(2)}),))
        for name in ("random", "multi-resolution")
    )
    grown = Study("trials", (Part({"scenario": ("sphere",), "planner": ("random",), "seed": range(4)}),))
    path = Path("renders/trials")
    assert can_hold(path, small)
    with CampaignFolder(path) as folder:
        folder.begin(small)
        for trial in small.trials():
            folder.journal.append({"settings": trial.settings, "row": {"status": "finished"}})
    assert can_hold(path, small)
    assert can_hold(path, grown)
    assert not can_hold(path, other)


def test_the_name_of_a_study_of_reach_says_scenario_and_arms() -> None:
    options = parse_command(["reach", "--scenario", "sphere", "--arm", "lab/arm.xml"])
    assert isinstance(options, reach.Options)
    assert options.out_folder(options.make_scenario()) == Path("renders/reach-sphere-arm")


def test_files_of_one_name_are_told_apart_by_their_folders() -> None:
    assert folder_names(["ur/arm.xml", "panda/arm.xml", "default"]) == ["ur-arm", "panda-arm", "default"]
    assert folder_names(["a/x/arm.xml", "b/x/arm.xml"]) == ["x-arm", "x-arm-2"]


def test_a_picture_of_another_file_is_not_replaced() -> None:
    first, second = (parse_command(["inspect", name]) for name in ("one/liver.nii.gz", "two/liver.nii.gz"))
    assert isinstance(first, inspection.Options)
    assert isinstance(second, inspection.Options)
    assert first.picture == Path("renders/inspect-liver.png")
    Path("renders").mkdir()
    save(Figure(figsize=(1, 1)), first.picture, source=str(first.file.absolute()))
    assert first.picture == Path("renders/inspect-liver.png")
    assert second.picture == Path("renders/inspect-liver-2.png")


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
def test_make_never_replaces_a_run_and_takes_any_folder() -> None:
    def words(*arguments: str) -> str:
        return subprocess.run(
            ["make", "-n", "-C", str(ROOT), "episode", *arguments], capture_output=True, text=True, check=True
        ).stdout

    assert "--overwrite" not in words()
    assert "--out" not in words()
    assert "--out 'my run'" in words("OUT=my run")

"""Every code block of the pages does what it says: commands are understood, files load, Python runs."""

from __future__ import annotations

import dataclasses
import re
import shlex
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest
from page_commands import PAGES, ROOT, Command, all_commands, blocks, make_clone, provide_files

from sim.campaign.study_file import load_study
from sim.cli import trials
from sim.cli.command_line import main, parse_command
from sim.episode.scenario import Scenario
from sim.episode.scenario_file import load_scenario
from sim.running.config import EpisodeConfig
from sim.running.parts import check_config
from sim.world.scene.arm import ArmModel

OTHER_PROGRAMS = {"pip", "dask", "sounding"}
"""Programs besides ours that a page may tell to run; those of a cluster need one."""


QUICK = ("inspect", "ik", "doctor")
"""Commands that are run here as they are printed; `pytest -m slow tests/test_docs_commands.py` runs all."""


def files(language: str) -> list[tuple[str, str]]:
    """Page and content of each block of a language."""
    return [(page.name, text) for page in PAGES for text in blocks(page, language)]


def lines() -> list[list[str]]:
    """The words of every line of every shell block, each once."""
    return [list(line) for line in dict.fromkeys(tuple(command.words) for command in all_commands())]


def commands(program: str) -> list[list[str]]:
    return [line[1:] for line in lines() if Path(line[0]).name == program]


def quick_commands() -> list[Command]:
    """Those of `QUICK`, each once."""
    quick = [each for each in all_commands() if len(each.words) > 1 and each.words[1] in QUICK]
    return list({tuple(each.words): each for each in quick}.values())


def test_every_block_is_of_a_kind_that_is_tested() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    kinds = re.findall(r"^```(\w*)$", text, re.MULTILINE)
    assert set(kinds[::2]) <= {
        "sh",
        "toml",
        "xml",
        "python",
        "text",
    }  # text: what a program prints, or takes hours


@pytest.mark.parametrize("arguments", commands("sounding"), ids=" ".join)
def test_every_command_is_understood(arguments: list[str]) -> None:
    options = parse_command(arguments)
    if isinstance(options, trials.Options):
        assert len(options.make_study()) > 0
    if isinstance(options, EpisodeConfig) and not options.scenario.endswith(".toml"):
        check_config(options)


@pytest.mark.parametrize("command", quick_commands(), ids=str)
def test_a_quick_command_does_what_its_page_says(command: Command, tmp_path, monkeypatch, capsys) -> None:
    folder = make_clone(tmp_path / "clone", command.page)
    provide_files(folder, command)
    monkeypatch.chdir(folder)
    assert main(command.words[1:]) == 0
    assert capsys.readouterr().err == ""


def test_every_other_line_names_a_program_or_a_target_that_exists() -> None:
    for line in lines():
        if line[0] == "make":
            subprocess.run(["make", "--dry-run", *line[1:]], cwd=ROOT, capture_output=True, check=True)
        elif line[0].endswith("python"):
            assert (ROOT / Path(*line[2].split("."))).with_suffix(".py").is_file(), line
        else:
            assert Path(line[0]).name in OTHER_PROGRAMS, line


@pytest.mark.parametrize(("page", "text"), files("toml"), ids=lambda each: each[:20])
def test_every_toml_file_loads(page: str, text: str, tmp_path) -> None:
    file = tmp_path / "file.toml"
    file.write_text(text)
    if "[axes]" in text:
        assert len(load_study(str(file))) > 0
    else:
        assert load_scenario(str(file)).name


def test_every_field_of_a_scenario_is_on_its_page() -> None:
    page = (ROOT / "docs" / "scenario.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_]+)`", "".join(re.findall(r"^\|([^|]*)\|", page, re.MULTILINE))))
    assert named == {"base"} | {field.name for field in dataclasses.fields(Scenario)}


@pytest.mark.parametrize(("page", "text"), files("xml"), ids=lambda each: each[:20])
def test_every_arm_can_be_used(page: str, text: str, tmp_path) -> None:
    (tmp_path / "arm.xml").write_text(text)
    arm = ArmModel(path=tmp_path / "arm.xml").load()
    assert arm.spec.compile().nq == len(arm.home_q) >= 5  # three for the tip's place, two for its beam
    assert isinstance(arm.spec, mujoco.MjSpec)
    assert arm.notices == ()


def test_the_python_of_every_page_runs() -> None:
    for page in PAGES:
        names: dict[str, object] = {}
        for _, text in (block for block in files("python") if block[0] == page.name):
            exec(compile(text, page.name, "exec"), names)  # the pages' own code, from this repository


def test_the_quick_start_runs_as_printed(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    printed = [
        shlex.split(line, comments=True)[1:]
        for line in page.splitlines()
        if line.startswith(".venv/bin/sounding")
    ]
    (episode,) = [line for line in printed if "renders/first" in line and line[0] == "episode"]
    (report,) = [line for line in printed if line[0] == "report"]
    assert main(episode) == 0
    assert main(report) == 0
    assert (tmp_path / "renders/first/report.html").stat().st_size > 100_000


def test_the_site_is_built_without_a_warning(tmp_path) -> None:
    pytest.importorskip("material", reason="the site needs pip install 'sounding[docs]'")
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    page = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert "Quick start" in page
    assert not re.findall(r'<(?:link|script|img)[^>]+(?:href|src)="https?:', page)  # it needs no network

"""Every code block of the pages does what it says: commands are understood, files load, Python runs."""

from __future__ import annotations

import dataclasses
import json
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from page_commands import PAGES, ROOT, Command, all_commands, blocks, make_clone, provide_files

from sim.campaign.study_file import load_study
from sim.cli import trials
from sim.cli.command_line import main, parse_command
from sim.episode.scenario import Scenario
from sim.episode.scenario_file import FILE_KEYS, LABEL_KEYS, READING_KEYS, load_scenario
from sim.plugs import MAP, PLANNER, SENSOR
from sim.running.config import EpisodeConfig
from sim.running.fields import recorded
from sim.running.parts import check_config
from sim.world.frames import quaternion_matrix
from sim.world.probes.probe import ProbeModel
from sim.world.scene.arm import ArmModel

OTHER_PROGRAMS = {"pip", "dask", "sounding"}
"""Programs besides ours that a page may tell to run; those of a cluster need one."""


QUICK = ("inspect", "ik", "doctor")
"""Commands that are run here as they are printed; `pytest -m slow tests/docs/test_docs_commands.py` runs all."""


def files(language: str) -> list[tuple[str, str]]:
    """Page and content of each block of a language."""
    return [(page.name, text) for page in PAGES for text in blocks(page, language)]


def lines() -> list[list[str]]:
    """The words of every line of every shell block, each once."""
    return [list(line) for line in dict.fromkeys(tuple(command.words) for command in all_commands())]


def our_commands() -> list[Command]:
    """Those of `sounding`, each once."""
    return [each for each in all_commands() if Path(each.words[0]).name == "sounding"]


def provide_config(folder: Path, command: Command) -> None:
    """Write the config.json that a command names, of the command of its page that writes there."""
    file = folder / command.words[command.words.index("--config") + 1]
    out = ["--out", str(file.parent.relative_to(folder))]
    (first,) = [
        each
        for each in our_commands()
        if each.page == command.page and each.words[-2:] == out and each != command
    ]
    options = parse_command(first.words[1:])
    assert isinstance(options, EpisodeConfig)
    file.parent.mkdir(parents=True)
    file.write_text(json.dumps({"options": recorded(options)}))


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


@pytest.mark.parametrize("command", our_commands(), ids=str)
def test_every_command_is_understood(command: Command, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(make_clone(tmp_path / "clone", command.page))
    if "--config" in command.words:
        provide_config(Path.cwd(), command)
    options = parse_command(command.words[1:])
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
            file = Path(*line[2].split(".")).with_suffix(".py") if line[1] == "-m" else Path(line[1])
            assert (ROOT / file).is_file(), line
        else:
            assert Path(line[0]).name in OTHER_PROGRAMS, line


@pytest.mark.parametrize(("page", "text"), files("toml"), ids=lambda each: each[:20])
def test_every_toml_file_loads(page: str, text: str, tmp_path) -> None:
    file = tmp_path / "file.toml"
    file.write_text(text)
    if "[project" in text:
        check_entry_points(text)
    elif "[axes]" in text:
        assert len(load_study(str(file))) > 0
    else:
        assert load_scenario(str(file)).name


def check_entry_points(text: str) -> None:
    """The groups of entry points are those that are looked up, and the classes those of the examples."""
    groups = tomllib.loads(text)["project"]["entry-points"]
    assert set(groups) == {kind.group for kind in (MAP, PLANNER, SENSOR)}
    examples = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "examples").glob("*.py"))
    for group in groups.values():
        for value in group.values():
            assert re.search(rf"^class {value.partition(':')[2]}\b", examples, re.MULTILINE)


def test_every_key_of_a_scenario_file_is_on_its_page() -> None:
    page = (ROOT / "docs" / "scenario.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([a-z_]+)`", "".join(re.findall(r"^\|([^|]*)\|", page, re.MULTILINE))))
    fields = {field.name for field in dataclasses.fields(Scenario)} - {"files"}
    assert named == {"base", "label_coding", *fields, *FILE_KEYS, *LABEL_KEYS, *READING_KEYS}


ARMS = [each for each in files("xml") if each[0] != "probe.md"]
PROBES = [each for each in files("xml") if each[0] == "probe.md"]


@pytest.mark.parametrize(("page", "text"), PROBES)
def test_every_probe_can_be_used(page: str, text: str, tmp_path) -> None:
    (tmp_path / "probe.xml").write_text(text)
    probe = ProbeModel(path=tmp_path / "probe.xml").load()
    assert probe is not None
    assert probe.notices == ()
    # The text says 45 degrees: the beam halves the right angle between the flange's +z and its +x.
    beam = quaternion_matrix(probe.tip.quaternion)[:, 2]
    np.testing.assert_allclose(beam, [np.sqrt(0.5), 0.0, np.sqrt(0.5)], atol=1e-9)


@pytest.mark.parametrize(("page", "text"), ARMS, ids=lambda each: each[:20])
def test_every_arm_can_be_used(page: str, text: str, tmp_path) -> None:
    (tmp_path / "arm.xml").write_text(text)
    arm = ArmModel(path=tmp_path / "arm.xml").load()
    assert arm.spec.compile().nq == len(arm.home_q) >= 5  # three for the tip's place, two for its beam


def test_the_python_of_every_page_runs(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for page in PAGES:
        if page.name in ("python.md", "gym.md"):  # they have tests of their own; the second needs an extra
            continue
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


EXAMPLE = re.compile(r"^<!-- code: (examples/\w+\.py) -->$", re.MULTILINE)
"""What the site replaces by the file; see docs/_example_code.py."""


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("own-*.md")), ids=lambda page: page.name)
def test_a_recipe_shows_its_example_and_links_it(page: Path) -> None:
    (example,) = EXAMPLE.findall(page.read_text(encoding="utf-8"))
    assert (ROOT / example).is_file()
    assert f"[{example}](../{example})" in page.read_text(encoding="utf-8")  # for readers on a code host


def test_the_site_is_built_without_a_warning(tmp_path) -> None:
    pytest.importorskip("material", reason="the site needs pip install 'sounding[docs]'")
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    page = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert "Quick start" in page
    recipe = (tmp_path / "site" / "own-planner.html").read_text(encoding="utf-8")
    assert "class LeastSure(sounding.Planner):" in re.sub(r"<[^>]+>", "", recipe)
    assert not re.findall(r'<(?:link|script|img)[^>]+(?:href|src)="https?:', page)  # it needs no network

"""The README's commands and files do what it says; that each is understood is in the tests of all pages."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

from sim.cli.command_line import main
from sim.episode.scenario_file import load_scenario

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def commands(program: str) -> list[list[str]]:
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    words = [shlex.split(line, comments=True) for line in lines]
    return [line[1:] for line in words if line and Path(line[0]).name == program]


def test_a_command_runs_as_printed(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    (arguments,) = [line for line in commands("sounding") if "random" in line]
    assert main(arguments) == 0
    assert "written to renders/sphere-random-none-0" in capsys.readouterr().out
    assert (tmp_path / "renders/sphere-random-none-0/summary.json").exists()


def test_make_passes_its_variables_through() -> None:
    words = re.search(r"`(make episode PLANNER[^`]*)`", README)
    assert words is not None
    dry = subprocess.run(
        [words[1].split()[0], "--dry-run", *words[1].split()[1:]], cwd=ROOT, capture_output=True, text=True
    )
    for expected in ("--planner 'random'", "--scenario 'sphere'", "--steps 10"):
        assert expected in dry.stdout


def test_the_scenario_file_loads(tmp_path) -> None:
    (text,) = blocks("toml")
    (tmp_path / "case.toml").write_text(text)
    assert load_scenario(str(tmp_path / "case.toml")).n_tumours == 5


def test_every_file_that_is_linked_exists() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert target.startswith("http") or (ROOT / target).exists(), target

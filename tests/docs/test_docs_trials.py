"""The page about trials: its commands are understood and its study file loads."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from sim.campaign.study_file import load_study
from sim.cli.command_line import parse_command
from sim.cli.trials import Options

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "trials.md").read_text(encoding="utf-8")


def commands() -> list[list[str]]:
    lines = [
        line for block in re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL) for line in block.splitlines()
    ]
    words = [shlex.split(line, comments=True) for line in lines]
    return [line[1:] for line in words if line and Path(line[0]).name == "sounding"]


@pytest.mark.parametrize("arguments", commands(), ids=" ".join)
def test_every_command_is_understood(arguments) -> None:
    options = parse_command(arguments)
    if isinstance(options, Options):
        assert len(options.make_study()) > 0


def test_the_study_file_loads(tmp_path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "study.toml").write_text(text)
    assert len(load_study(str(tmp_path / "study.toml"))) == 2 * 2 * 100


def test_the_page_of_results_has_the_place_that_make_paper_writes_to() -> None:
    from benchmarks.paper import BEGIN, END

    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert page.count(BEGIN) == page.count(END) == 1
    assert page.index(BEGIN) < page.index(END)

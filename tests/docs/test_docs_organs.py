"""The page about organs: its commands are understood, and every flag for a patient's files has one."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from sim.cli.command_line import parse_command
from sim.running.case import PATIENT_FIELDS
from sim.running.config import EpisodeConfig
from sim.running.parts import scenario_of

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "organs.md").read_text(encoding="utf-8")


def commands() -> list[list[str]]:
    blocks = re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL)
    words = [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]
    return [line[1:] for line in words if line and Path(line[0]).name == "sounding"]


@pytest.mark.parametrize("arguments", commands(), ids=" ".join)
def test_every_command_is_understood(arguments: list[str]) -> None:
    options = parse_command(arguments)
    if isinstance(options, EpisodeConfig):
        scenario_of(options)


@pytest.mark.parametrize(
    "name", [*PATIENT_FIELDS, "organ_pose", "coding", "mesh_frame", "keepout_mm", "n_tumours"]
)
def test_every_flag_is_on_the_page(name: str) -> None:
    assert f"--{name.replace('_', '-')}" in PAGE


@pytest.mark.parametrize("target", re.findall(r"\]\((figures/[^)]*)\)", PAGE))
def test_every_picture_is_there(target: str) -> None:
    assert (ROOT / "docs" / target).is_file()

"""The page for scripts: its code runs from top to bottom, and every name of the front door has a chapter there."""

from __future__ import annotations

import inspect
import re

import pytest
from page_commands import ROOT, blocks

import sounding

PAGE = ROOT / "docs" / "python.md"
TEXT = PAGE.read_text(encoding="utf-8")


def chapter(name: str) -> str:
    """What the page says of a name, from its heading to the next."""
    (text,) = re.findall(rf"^### {name}\n(.*?)(?=^##|\Z)", TEXT, re.DOTALL | re.MULTILINE)
    return text


def told_parameters(signature: str) -> list[str]:
    """The names of parameters in a signature as the page writes it; `...` stands for some that are left out."""
    inside = re.sub(r"\([^()]*\)", "", signature.partition("(")[2].removesuffix(")"))
    parts = [part.strip().partition("=")[0].lstrip("*") for part in inside.split(",")]
    return [part for part in parts if part and part != "..."]


def test_the_page_runs_from_top_to_bottom(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks(PAGE, "python"):
        exec(compile(block, PAGE.name, "exec"), names)  # the page's own code, from this repository
    assert (tmp_path / "renders/first/summary.json").is_file()
    assert (tmp_path / "renders/short/compare/compare.md").is_file()
    assert "\n6 0\n" in capsys.readouterr().out  # six trials, none failed


@pytest.mark.parametrize("name", sounding.__all__)
def test_every_name_has_its_chapter_with_its_signature(name: str) -> None:
    ((written, said),) = re.findall(r"\A\n```text\n(.*?)\n```\n\n(.*)", chapter(name), re.DOTALL)
    signature = " ".join(written.split())
    assert signature.split("(")[0] == name
    assert re.match(r"[A-Z].*?\.", said, re.DOTALL), "a sentence says what it is for"
    if "(" in signature:
        known = list(inspect.signature(getattr(sounding, name)).parameters)
        told = told_parameters(signature)
        assert told == [each for each in known if each in told]
        assert "..." in signature or told == known


def test_no_chapter_is_of_a_name_that_is_gone() -> None:
    assert sorted(re.findall(r"^### (\w+)$", TEXT, re.MULTILINE)) == sorted(sounding.__all__)


def test_every_example_is_in_the_table() -> None:
    listed = re.findall(r"\]\(\.\./examples/(example_\d\d_\w+\.py)\)", TEXT)
    assert listed == sorted(path.name for path in (ROOT / "examples").glob("example_*.py"))

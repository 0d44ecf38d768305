"""What pages and programs tell a reader to type is there after `make episode`: nothing is on the PATH but make."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from page_commands import PAGES, ROOT, all_commands

OURS = ("sounding", "python", "pip", "dask", "pytest", "ruff", "pyright")
"""Programs of .venv/bin."""
MORE_PAGES = (ROOT / "models" / "README.md", ROOT / "CONTRIBUTING.md")
SOURCES = sorted(
    path
    for room in ("sim", "planner", "mapping", "benchmarks", "examples")
    for path in (ROOT / room).rglob("*.py")
)
TYPED = re.compile(r"(?<![\w/.-])(?:python -m (?!pip install\b)[\w.]+|pip install|pytest -)")
"""Commands that nobody types but in an environment that is active."""


def bare(text: str) -> list[str]:
    """Commands in a text that a shell would not find, and inline ones of ours with arguments."""
    inline = re.findall(r"`((?:sounding|python|pip) [a-z]+ [^`\n]+)`", text)
    return [*TYPED.findall(text), *inline]


def texts(path: Path) -> str:
    """Docstrings and messages of a source, the f-strings' fixed parts among them."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    return "\n".join(
        each.value for each in nodes if isinstance(each, ast.Constant) and isinstance(each.value, str)
    )


def test_every_line_of_a_shell_block_begins_with_a_program_that_is_there() -> None:
    for command in all_commands():
        program = command.words[0]
        assert program == "make" or program in {f".venv/bin/{name}" for name in OURS}, str(command)


@pytest.mark.parametrize("page", [*PAGES, *MORE_PAGES], ids=lambda path: str(path.relative_to(ROOT)))
def test_no_page_tells_a_command_that_is_not_found(page: Path) -> None:
    assert bare(page.read_text(encoding="utf-8")) == []


def test_no_message_or_docstring_tells_a_command_that_is_not_found() -> None:
    allowed = {
        "sim/extras.py",  # makes the commands for the Python that runs
        "sim/cli/__main__.py",  # is what `python -m sim.cli` runs
    }
    found = {str(path.relative_to(ROOT)): bare(texts(path)) for path in SOURCES}
    assert {name: each for name, each in found.items() if each and name not in allowed} == {}


@pytest.mark.parametrize(
    "text",
    ["run pip install 'x'", "`python -m benchmarks.ik`", "`sounding ik --standoff-mm 0`", "pytest -m slow"],
)
def test_a_bare_command_is_found(text: str) -> None:
    assert bare(text)


@pytest.mark.parametrize(
    "text", ["`.venv/bin/sounding ik --x 1`", "`sounding reach` tries", ".venv/bin/python -m benchmarks.ik"]
)
def test_a_name_and_a_whole_command_are_let_pass(text: str) -> None:
    assert not bare(text)

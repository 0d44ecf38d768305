"""Flags belong to the command line: below it, nothing imports its parser, and no text speaks of a flag."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FLAG = re.compile(r"(?<![\w-])--[a-z][\w-]*")
FLAGS_OF_OTHERS = {
    # What each extra gives is said as a command, for `sounding doctor` and for errors.
    "sim/extras.py": {"--video", "--rerun", "--parquet", "--engine", "--sensor", "--format"},
    # What Git is called with to tell the version of the code.
    "sim/record/run_folder.py": {"--always", "--abbrev", "--dirty", "--exclude"},
    # A program of its own, run by its module's name.
    "sim/world/anatomy/liver_generator.py": {"--seed", "--volume-ml", "--triangles", "--template", "--out"},
}
"""Flags that are not Sounding's, by the file whose texts hold them."""
MODULES = [
    path
    for place in ("mapping", "planner", "sim")
    for path in sorted((ROOT / place).rglob("*.py"))
    if "cli" not in path.relative_to(ROOT).parts
]


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def texts(tree: ast.AST) -> list[str]:
    """All texts of a module: messages, the fixed parts of f-strings, and docstrings."""
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]


def imported(tree: ast.AST) -> set[str]:
    """The names of all that a module imports, wherever in it the import stands."""
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    return names | {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}


def flags(tree: ast.AST) -> set[str]:
    """The flags that a module's texts speak of."""
    return {flag for text in texts(tree) for flag in FLAG.findall(text)}


def test_a_flag_is_seen_wherever_in_a_text_it_stands() -> None:
    """What the tests below stand on; a dash between words is no flag."""
    source = '"""Run `--out-folder x`."""\nraise Error(f"{value}: leave --arm out")\n"a -- b, a--b, ---"'
    assert flags(ast.parse(source)) == {"--out-folder", "--arm"}


def test_no_text_below_the_command_line_speaks_of_its_flags() -> None:
    found = {relative(path): flags(ast.parse(path.read_text())) for path in MODULES}
    assert {path: own for path, own in found.items() if own} == FLAGS_OF_OTHERS


def test_nothing_below_the_command_line_imports_its_parser() -> None:
    found = {relative(path): imported(ast.parse(path.read_text())) for path in MODULES}
    knowing = {
        path for path, names in found.items() if any(f"{n}.".startswith(("tyro.", "sim.cli.")) for n in names)
    }
    assert len(found) > 150
    assert not knowing

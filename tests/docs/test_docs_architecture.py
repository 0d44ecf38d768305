"""The page about the architecture tells of the house as it is: its rooms in order, and names that the code has."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PACKAGES = ("mapping", "planner", "sim")
OTHER_WORDS = {"examples", "benchmarks", "models", "assets", "full", "diagonal", "organ_label"}
"""Names in backticks that no definition in the code bears: folders outside packages, forms and options."""


def rooms_of_the_test() -> list[str]:
    """The rooms in their order, as the test of the architecture has them."""
    tree = ast.parse((ROOT / "tests" / "test_architecture.py").read_text(encoding="utf-8"))
    values = {
        node.targets[0].id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    within = ast.literal_eval(values["WITHIN"])
    rooms = []
    for room in ast.literal_eval(values["ROOMS"]):
        rooms += [room, *(inner for inner, outer in within.items() if outer == room)]
    return rooms


def rooms_of_the_page() -> list[str]:
    """The rooms in the order of the page's table."""
    rows = re.findall(r"^\| `([a-z_/]+)/` \|", PAGE, re.MULTILINE)
    return [row.replace("/", ".") for row in rows]


def test_the_table_has_every_room_in_its_order() -> None:
    # The engines have no row: the campaign's names them.
    assert rooms_of_the_page() == [room for room in rooms_of_the_test() if not room.endswith("engines")]


def test_every_file_the_page_names_exists() -> None:
    named = set(re.findall(r"`([a-z_/]+\.py)`", PAGE))
    assert len(named) >= 4
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []


def test_every_name_on_the_page_is_one_of_the_code() -> None:
    """Names of before a move do not stay behind."""
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    words = {path.stem for path in files} | {path.parent.name for path in files} | {"sounding"}
    for path in files:
        words |= set(re.findall(r"[A-Za-z_]\w*", path.read_text(encoding="utf-8")))
    named = {name.rpartition(".")[2] for name in re.findall(r"`([A-Za-z_][\w.]*)`", PAGE)} - {"py", "json"}
    assert len(named) > 50
    assert sorted(named - words - OTHER_WORDS) == []

"""The page about the map: its example runs and finds its tumour, and what it names exists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "map.md").read_text(encoding="utf-8")
EQUATIONS = "## The paper's equations and where they are"


def test_the_pages_example_maps_its_tumour(capsys):
    names = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL):
        exec(compile(block, "docs/map.md", "exec"), names)  # the page's own code, from this repository
    # A thousand noiseless points in a box of 6 cm see all of a ball of 24 mm.
    assert names["metrics"].auprc > 0.95
    assert capsys.readouterr().out.startswith("rank ")


def test_every_module_the_page_names_exists():
    named = set(re.findall(r"`([a-z_/]+\.py)`", PAGE))
    assert len(named) >= 8
    modules = {path.name for path in (ROOT / "mapping").rglob("*.py")}
    assert [name for name in named if name not in modules and not (ROOT / name).is_file()] == []


def equations():
    """Each row of the table of equations: what the paper calls it, the file, and the functions."""
    rows = []
    for line in PAGE.split(EQUATIONS)[1].splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) == 5 and cells[2].startswith("`"):
            rows.append((cells[0], cells[2].strip("`"), re.findall(r"`([\w.]+)`", cells[3])))
    return rows


def found(path, dotted):
    """The class or function of a dotted name in a file, without importing it; None if there is none."""
    node = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    for name in dotted.split("."):
        kinds = (ast.FunctionDef, ast.ClassDef)
        node = next((each for each in node.body if isinstance(each, kinds) and each.name == name), None)
        if node is None:
            return None
    return node


def test_the_table_has_both_numbered_equations_and_both_algorithms():
    named = " ".join(name for name, _, _ in equations())
    assert {"eq. 1", "eq. 2", "Algorithm 1", "Algorithm 2"} <= set(re.findall(r"eq\. \d|Algorithm \d", named))


@pytest.mark.parametrize(("equation", "path", "functions"), equations(), ids=lambda value: str(value))
def test_every_function_that_the_page_names_for_an_equation_exists_and_says_what_it_is(
    equation, path, functions
):
    assert functions
    for dotted in functions:
        node = found(path, dotted)
        assert node is not None, f"{path} has no {dotted}"
        text = ast.get_docstring(node)
        assert text, f"{dotted} has no docstring"
        assert not any(part.startswith("_") for part in dotted.split(".")), f"{dotted} is not public"
        if equation.startswith("eq. "):
            assert equation in text, f"the docstring of {dotted} does not name {equation}"

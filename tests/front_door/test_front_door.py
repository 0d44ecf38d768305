"""The front door: `import sounding` costs nothing, and every name leads to what its home defines."""

from __future__ import annotations

import ast
import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import sounding

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ast.parse((ROOT / "sounding.py").read_text())


def loaded_by(statement: str) -> set[str]:
    """The modules that a fresh process loads for a statement, beyond those of Python's own start."""
    code = f"import json, sys; before = set(sys.modules); {statement}; print(json.dumps([*set(sys.modules) - before]))"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(json.loads(run.stdout))


def tops(modules: set[str]) -> set[str]:
    return {module.partition(".")[0] for module in modules}


def test_the_import_loads_one_file_and_of_the_rest_only_the_standard_library() -> None:
    assert tops(loaded_by("import sounding")) - set(sys.stdlib_module_names) == {"sounding"}


def test_a_name_loads_only_what_it_needs() -> None:
    """A planner of one's own is written with the science, without a simulator or a command line."""
    modules = tops(loaded_by("from sounding import HilbertMap, Planner, make_study"))
    assert {"mapping", "planner", "numpy"} <= modules
    assert not {"mujoco", "mink", "trimesh", "tyro", "matplotlib"} & modules


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import sim.episode.episode", {"tyro"}),
        ("from sim.report import write_report", {"sim.campaign", "sim.comparison", "tyro"}),
        # The campaign's own process, which may run for days beside its workers, needs no simulator.
        ("import sim.running.config, sim.campaign.study, sim.campaign.campaign", {"mujoco", "mink", "tyro"}),
    ],
)
def test_a_part_does_not_load_what_stands_above_or_beside_it(statement, absent) -> None:
    assert not absent & loaded_by(statement)


@pytest.mark.parametrize("name", sounding.__all__)
def test_a_name_is_what_its_home_defines(name) -> None:
    home = importlib.import_module(sounding._HOMES[name])
    found = getattr(sounding, name)
    assert found is getattr(home, name)
    assert found.__doc__
    assert vars(sounding)[name] is found  # kept: the next use looks nothing up


def test_the_lists_of_names_agree() -> None:
    """What a type checker reads, what Python loads and what `from sounding import *` gives."""
    checked = {
        alias.name: node.module
        for block in SOURCE.body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for node in ast.walk(block)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert checked == sounding._HOMES
    assert sounding.__all__ == sorted(sounding._HOMES) == dir(sounding)
    starred: dict[str, object] = {}
    exec("from sounding import *", starred)
    assert starred.keys() - {"__builtins__"} == set(sounding.__all__)


def test_a_name_that_is_not_there_is_answered_with_those_that_are() -> None:
    with pytest.raises(AttributeError) as caught:
        sounding.Robot  # noqa: B018
    assert "'Robot'" in str(caught.value)
    assert all(name in str(caught.value) for name in sounding.__all__)
    assert not hasattr(sounding, "__path__")  # what Python asks of everything that is imported

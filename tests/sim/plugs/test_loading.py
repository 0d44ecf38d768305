"""Plugs by text: from the current folder, from entry points, and errors that say what to do."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from planner import ExpectedImprovement
from sim.errors import UsageError
from sim.plugs import MAP, PLANNER, SENSOR, PlugError, load_plug, make_plug, plug_names
from sim.world.sensing.sensor import Sensor

ROOT = Path(__file__).resolve().parents[3]

OWN_PLANNER = """
from dataclasses import dataclass
from planner import ExpectedImprovement, Planner

RATE = 0.5

@dataclass(frozen=True)
class LastFirst(Planner):
    step: int = 1
    needs_belief = False

    def __post_init__(self):
        if self.step < 1:
            raise ValueError(f"step={self.step}: must be 1 or more.")

    def rank(self, situation):
        yield from range(len(situation.workspace) - 1, -1, -self.step)

class Unfinished(Planner):
    needs_belief = False

class Careless(LastFirst):
    def __init__(self, n_poses: int, *, step: "int" = 2):
        raise KeyError("nowhere")

class Silent(Planner):
    def rank(self, situation):
        yield from ()

class Holder:
    Inner = LastFirst

def make():
    return LastFirst()
"""

OWN_SENSOR = """
from sim.world.sensing.sensor import Sensor

class Blind(Sensor):
    def sense(self, state, rng):
        raise NotImplementedError

class Free:
    def sense(self, state, rng):
        raise NotImplementedError

class Dumb:
    pass

class Open(Sensor):
    pass
"""


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """The current folder, with modules in it that are forgotten after the test."""
    before = set(sys.modules)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_planner.py").write_text(OWN_PLANNER)
    (tmp_path / "own_sensor.py").write_text(OWN_SENSOR)
    yield tmp_path
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def add_package(folder: Path, name: str, group: str, entries: dict[str, str]) -> None:
    """Lay down what an installed package tells of itself."""
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [f"{entry} = {value}" for entry, value in entries.items()]
    (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines, ""]))


def error_of(text: str, kind=PLANNER, options: dict | None = None, **more) -> str:
    """What is said of a bad text, without line breaks in it."""
    with pytest.raises(PlugError) as caught:
        make_plug(text, kind, options or {}, **more)
    assert isinstance(caught.value, UsageError)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_class_in_the_current_folder_is_loaded_and_made(folder) -> None:
    assert load_plug("own_planner:LastFirst", PLANNER).__name__ == "LastFirst"
    assert make_plug("own_planner:LastFirst", PLANNER, {"step": 3}).step == 3
    assert make_plug("own_sensor:Blind", SENSOR, {}).__class__.__mro__[1] is Sensor


def test_a_dotted_name_may_follow_the_colon_and_precede_it(folder) -> None:
    (folder / "pack").mkdir()
    (folder / "pack" / "__init__.py").touch()
    (folder / "pack" / "inner.py").write_text(OWN_PLANNER)
    assert load_plug("pack.inner:Holder.Inner", PLANNER).__module__ == "pack.inner"
    assert load_plug("planner:ExpectedImprovement", PLANNER) is ExpectedImprovement


def test_a_sensor_may_be_any_class_with_a_method_sense(folder) -> None:
    assert load_plug("own_sensor:Free", SENSOR).__name__ == "Free"


def test_a_map_may_be_a_function(folder) -> None:
    (folder / "own_map.py").write_text("def make(*, cells=3): return ['map'] * cells\n")
    assert make_plug("own_map:make", MAP, {"cells": 2}) == ["map", "map"]
    assert "is an object of the type float; a map is a class or a function" in error_of(
        "own_planner:RATE", MAP
    )


INSTALLED = "import sys; from sim.plugs import *; print(load_plug(sys.argv[1], PLANNER).__name__)"


def run_command(code: str, folder: Path, *arguments: str, **env: str) -> subprocess.CompletedProcess:
    """Run code as an installed command does: its own folder is on Python's path, the current one is not."""
    command = folder / "bin" / "command.py"
    command.parent.mkdir()
    command.write_text(code)
    return subprocess.run(
        [sys.executable, str(command), *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", **env},
        capture_output=True,
        text=True,
    )


def test_an_installed_command_finds_the_module_beside_the_user(tmp_path) -> None:
    (tmp_path / "own_planner.py").write_text(OWN_PLANNER)
    run = run_command(INSTALLED, tmp_path, "own_planner:LastFirst")
    assert (run.stdout, run.stderr) == ("LastFirst\n", "")


def test_what_is_installed_takes_precedence_over_the_current_folder(tmp_path) -> None:
    """A file that is named like an installed module changes nothing for those who import that module."""
    (tmp_path / "colorsys.py").write_text(OWN_PLANNER)
    (tmp_path / "own_planner.py").write_text("import colorsys\nassert colorsys.rgb_to_hsv\n" + OWN_PLANNER)
    run = run_command(INSTALLED, tmp_path, "own_planner:LastFirst")
    assert (run.stdout, run.stderr) == ("LastFirst\n", "")


def test_a_plug_may_import_its_neighbours_later_on(folder) -> None:
    (folder / "neighbour.py").write_text("STEP = 7\n")
    late = "class Late(LastFirst):\n    def far(self):\n        import neighbour\n        return neighbour.STEP\n"
    (folder / "late.py").write_text(OWN_PLANNER + late)
    assert make_plug("late:Late", PLANNER, {}).far() == 7


def test_naming_and_loading_a_plug_needs_no_simulator(tmp_path) -> None:
    (tmp_path / "own_planner.py").write_text(OWN_PLANNER)
    (tmp_path / "own_sensor.py").write_text("class Free:\n    def sense(self, state, rng): pass\n")
    code = (
        "import sys\nfrom sim.plugs import *\n"
        "make_plug('own_planner:LastFirst', PLANNER, {'step': 2})\nload_plug('own_sensor:Free', SENSOR)\n"
        "print(sorted({'mujoco', 'mink', 'trimesh', 'tyro'} & set(sys.modules)))"
    )
    run = run_command(code, tmp_path)
    assert (run.stdout, run.stderr) == ("[]\n", "")


def test_importing_plugs_loads_no_planner_and_no_numpy() -> None:
    code = "import sys, sim.plugs; print(sorted({'mujoco', 'mink', 'numpy', 'planner'} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"


def test_an_entry_point_is_loaded_by_its_name(folder, monkeypatch) -> None:
    add_package(folder / "site", "fast_planners", PLANNER.group, {"last-first": "own_planner:LastFirst"})
    add_package(folder / "site", "odd_sensors", SENSOR.group, {"blind": "own_sensor:Blind"})
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder / "site"), str(folder)])
    assert plug_names(PLANNER) == ("last-first",)
    assert plug_names(SENSOR) == ("blind",)
    assert plug_names(MAP) == ()
    assert make_plug("last-first", PLANNER, {"step": 4}).step == 4


def test_an_entry_point_that_leads_nowhere_is_named_with_its_place(folder, monkeypatch) -> None:
    add_package(folder / "site", "old", PLANNER.group, {"gone": "lost:Planner", "bare": "own_planner"})
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder / "site"), str(folder)])
    assert error_of("gone").startswith("`planner` 'gone' (lost:Planner): there is no module lost, neither")
    assert "'bare' (own_planner): own_planner is a module; a planner is a class" in error_of("bare")


def test_a_name_that_two_packages_offer_is_not_guessed(folder, monkeypatch) -> None:
    add_package(folder / "site", "one", PLANNER.group, {"best": "own_planner:LastFirst"})
    add_package(folder / "site", "two", PLANNER.group, {"best": "own_planner:Silent"})
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder / "site")])
    assert error_of("best") == (
        "`planner` 'best' is offered more than once, as own_planner:LastFirst and own_planner:Silent; "
        "write the one that you mean."
    )


def test_an_unknown_name_lists_those_that_exist(folder, monkeypatch) -> None:
    assert error_of("besst") == (
        "`planner` 'besst': no planner has this name; write package.module:Class for one of your own."
    )
    add_package(folder / "site", "one", PLANNER.group, {"best": "own_planner:LastFirst"})
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder / "site")])
    assert "choose one of random, best, or write package.module:Class" in error_of(
        "besst", built_in=["random"]
    )


@pytest.mark.parametrize("text", ["own_planner.py:LastFirst", "./own_planner.py:LastFirst"])
def test_the_name_of_a_file_is_answered_with_that_of_its_module(folder, text: str) -> None:
    assert "names a file. Write the name of the module, own_planner:LastFirst, and run" in error_of(text)
    assert "own_planner:Class" in error_of("plans/own_planner.py")
    assert "own_planner:Mine" in error_of(r"C:\plans\own_planner.py:Mine")


@pytest.mark.parametrize("text", ["own_planner:", ":LastFirst", "own planner:A", "a:b:c", "own_planner:A()"])
def test_a_text_of_another_form_is_answered_with_the_form(folder, text: str) -> None:
    assert error_of(text) == (
        f"`planner` '{text}' has not the form package.module:Class; write it so, for example my_module:MyClass."
    )


def test_a_module_that_is_not_there(folder) -> None:
    assert error_of("lost:Planner") == (
        "`planner` 'lost:Planner': there is no module lost, neither installed nor in the current folder, "
        f"{folder}. Mend the name, install the module, or run in the folder that holds it."
    )
    assert "there is no module own_planner.inner" in error_of("own_planner.inner:A")


@pytest.mark.parametrize(
    ("code", "description"),
    [
        ("x = 1\n\nx / 0\n", "ZeroDivisionError: division by zero (broken.py, line 3)"),
        ("import lost_dependency\n", "ModuleNotFoundError: No module named 'lost_dependency' (broken.py, line 1)"),
        ("def f(:\n", "SyntaxError: invalid syntax (broken.py, line 1)"),
        ("import sys\nsys.exit(3)\n", "SystemExit: 3 (broken.py, line 2)"),
        ("def f():\n    assert False\nf()\n", "AssertionError (broken.py, line 2)"),
        ("import json\njson.loads('{')\n", "(broken.py, line 2)"),
    ],
)  # fmt: skip
def test_a_module_that_raises_is_named_with_its_error_and_line(folder, code: str, description: str) -> None:
    (folder / "broken.py").write_text(code)
    text = error_of("broken:A")
    assert text.startswith("`planner` 'broken:A': importing the module broken raised ")
    assert text.endswith(f"{description}. Mend the module.")


def test_a_class_that_the_module_lacks_is_answered_with_those_it_has(folder) -> None:
    assert error_of("own_planner:Lastfirst") == (
        f"`planner` 'own_planner:Lastfirst': the module own_planner ({folder / 'own_planner.py'}) has no Lastfirst. "
        "Choose from what the module defines: LastFirst, Careless."
    )
    assert error_of("own_planner:Blind", SENSOR).endswith(
        "has no Blind. The module defines no sensor; name another module, or define one in it."
    )
    assert "Choose from what the module defines: Blind, Free." in error_of("own_sensor:Seeing", SENSOR)


@pytest.mark.parametrize(
    ("text", "kind", "fault"),
    [
        (
            "own_planner:Holder",
            PLANNER,
            "Holder derives from another class; a planner is a class that derives",
        ),
        ("own_planner:make", PLANNER, "make is a function; a planner is"),
        ("own_planner:RATE", PLANNER, "RATE is an object of the type float; a planner is"),
        ("own_planner:Unfinished", PLANNER, "Unfinished does not define rank; a planner is"),
        ("own_planner:Silent", PLANNER, "Silent does not set needs_belief; a planner is"),
        ("own_sensor:Dumb", SENSOR, "Dumb has no method sense; a sensor is"),
        ("own_sensor:Open", SENSOR, "Open does not define sense; a sensor is"),
        ("own_planner:make", SENSOR, "make is a function; a sensor is"),
    ],
)
def test_what_is_of_another_kind_is_refused(folder, text: str, kind, fault: str) -> None:
    assert fault in error_of(text, kind)


def test_a_module_that_loads_its_names_on_first_use_may_raise_then(folder) -> None:
    (folder / "lazy.py").write_text("def __getattr__(name):\n    raise ImportError('no library')\n")
    assert error_of("lazy:A") == (
        "`planner` 'lazy:A': looking up A raised ImportError: no library (lazy.py, line 2). Mend the module."
    )


def test_options_that_the_class_does_not_take_are_answered_with_its_own(folder) -> None:
    assert error_of("own_planner:LastFirst", options={"stride": 2}) == (
        "`planner` 'own_planner:LastFirst' cannot be made with the options stride: got an unexpected keyword "
        "argument 'stride'. Its options are those of LastFirst(step=1)."
    )
    assert error_of("own_planner:Careless") == (
        "`planner` 'own_planner:Careless' cannot be made with no options: missing a required argument: 'n_poses'. "
        "Its options are those of Careless(n_poses, *, step=2)."
    )


def test_a_class_that_raises_as_it_is_made_is_named_with_its_error(folder) -> None:
    with pytest.raises(PlugError) as caught:
        make_plug("own_planner:LastFirst", PLANNER, {"step": 0})
    assert isinstance(caught.value.__cause__, ValueError)
    line = 1 + OWN_PLANNER.splitlines().index(
        '            raise ValueError(f"step={self.step}: must be 1 or more.")'
    )
    assert str(caught.value) == (
        "`planner` 'own_planner:LastFirst' raised ValueError: step=0: must be 1 or more "
        f"(own_planner.py, line {line}) as it was made. Mend it, or give it other options."
    )
    assert "raised KeyError: 'nowhere'" in error_of("own_planner:Careless", options={"n_poses": 3})

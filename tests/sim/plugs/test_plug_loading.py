"""Plugs by text: from the current folder and from entry points."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from own_plugs import OWN_PLANNER, add_package, error_of

from planner import ExpectedImprovement
from sim.plugs import MAP, PLANNER, SENSOR, load_plug, make_plug, plug_names
from sim.world.sensing.sensor import Sensor

ROOT = Path(__file__).resolve().parents[3]


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

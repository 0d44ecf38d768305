"""The wheel: it holds the packages and their data, nothing of the checkout, and works from an empty folder."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
import tomllib
import venv
import zipfile
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from sim.world.scene.arm import MODELS_DIR

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("sim", "planner", "mapping")
DATA = {".xml", ".json", ".stl", ".toml", ".j2", ".js", ".css", ".txt", ".md", ".safetensors"}
"""Endings of the files besides Python's that the packages read, and of what tells where those are from."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel of the checkout; hatchling takes half a second for it."""
    pytest.importorskip("hatchling", reason="needs pip install 'sounding[dev]'")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    return path


def held(wheel: Path) -> dict[str, bytes]:
    """What a wheel holds besides its own description, by path."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name}


def in_checkout(name: str) -> Path:
    """Where in the checkout a file of the wheel comes from."""
    return ROOT / name.replace("sim/_models/", "models/")


def test_the_wheel_puts_nothing_but_ours_at_the_top_of_site_packages(wheel) -> None:
    assert {name.partition("/")[0] for name in held(wheel)} == {*PACKAGES, "sounding.py"}


def test_the_wheel_holds_every_module_and_all_data_as_they_are_in_the_checkout(wheel) -> None:
    files = held(wheel)
    wanted = {"sounding.py"}
    for package in PACKAGES:
        found = (
            path for path in (ROOT / package).rglob("*") if path.is_file() and "__pycache__" not in path.parts
        )
        wanted |= {path.relative_to(ROOT).as_posix() for path in found}
    wanted |= {f"sim/_models/{path.name}" for path in (ROOT / "models").iterdir()}
    assert files.keys() == wanted
    assert {Path(name).suffix for name in wanted} == DATA | {".py"}
    assert all(content == in_checkout(name).read_bytes() for name, content in files.items())
    assert {
        "sim/campaign/studies/quick.toml",
        "sim/report/assets/run.html.j2",
        "sim/_models/liver.stl",
    } <= wanted


def test_models_are_found_beside_the_packages_of_a_checkout() -> None:
    assert MODELS_DIR == ROOT / "models"
    assert not (ROOT / "sim" / "_models").exists()  # a copy would hide what is changed in models/


def test_commands_named_by_the_project_s_files_exist() -> None:
    """The script that the wheel installs, and modules that the Makefile and the set-up run by name."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for name, value in project["scripts"].items():
        assert callable(EntryPoint(name, value, "console_scripts").load())
    files = (ROOT / "Makefile", *(ROOT / ".ci").iterdir())
    named = {
        name for path in files for name in re.findall(r"-m ((?:sim|benchmarks)[\w.]*)", path.read_text())
    }
    assert "sim.doctor.gl_probe" in named
    for name in named:
        path = ROOT.joinpath(*name.split("."))
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), name


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """A fresh environment that holds the wheel, and finds the packages that it needs in the running one."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(python),
        "install",
        "--no-deps",
        "--no-index",
        "--quiet",
    ]
    subprocess.run([*pip, str(wheel)], check=True)
    (site,) = folder.glob("lib/python*/site-packages")
    tops = {path.name for path in site.iterdir()} - {"__pycache__"}
    assert {name for name in tops if not name.endswith(".dist-info")} == {*PACKAGES, "sounding.py"}
    # Of the running environment its folder only: the .pth files in it, one of which may lead to the checkout, are not
    # read, and what the fresh environment holds itself comes first.
    others = [path for path in sys.path if path.endswith("site-packages")]
    (site / "needed.pth").write_text("\n".join(others) + "\n")
    return folder / "bin"


@pytest.fixture
def run(installed, tmp_path):
    """Runs a command of the fresh environment in an empty folder."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

    def call(command: str, *words: str) -> str:
        done = subprocess.run(
            [installed / command, *words], cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return call


@pytest.mark.slow
def test_an_installed_wheel_runs_from_an_empty_folder(run, installed, tmp_path) -> None:
    code = "import sounding, sim.world.scene.arm as arm; print(sounding.__file__); print(arm.MODELS_DIR)"
    site = installed.parent
    assert all(Path(line).is_relative_to(site) for line in run("python", "-c", code).splitlines())

    # The embedded arm before the embedded liver, with its report.
    run("sounding", "episode", "--steps", "2", "--seed", "1", "--out", "run")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["n_sensings"] == 2
    report = tmp_path / "run" / "report.html"
    page = report.read_bytes()
    report.unlink()
    run("sounding", "report", "run")
    assert report.read_bytes() == page

    # A study that the package brings, and its comparison.
    words = ("--planner", "random", "--trials", "2", "--steps", "5", "--jobs", "1", "--out", "trials")
    run("sounding", "trials", "--study", "quick", *words)
    rows = list(csv.DictReader((tmp_path / "trials" / "trials.csv").open()))
    assert [row["status"] for row in rows] == ["finished", "finished"]
    run("sounding", "compare", "trials")
    assert (tmp_path / "trials" / "compare" / "report.html").is_file()


@pytest.mark.slow
def test_an_installed_wheel_runs_an_example(run, tmp_path) -> None:
    assert "tumour sensed" in run("python", str(ROOT / "examples" / "example_01_first_episode.py"))
    assert (tmp_path / "renders" / "first-episode" / "report.html").is_file()

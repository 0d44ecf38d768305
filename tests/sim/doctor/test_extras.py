"""Packages that not everybody needs: what each gives, and the command that installs it for the Python that runs."""

import shlex
import sys
import tomllib
from pathlib import Path

import pytest

from sim import extras
from sim.doctor.diagnosis import find_extras
from sim.extras import EXTRAS, install_command, missing_text
from sim.world.errors import MissingPackageError
from sim.world.optional import optional_module

ROOT = Path(__file__).resolve().parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture
def clone(tmp_path, monkeypatch) -> Path:
    """A clone whose .venv is that of the Python that runs, with a space in its path."""
    folder = tmp_path / "my clone"
    folder.mkdir()
    (folder / "pyproject.toml").touch()
    (folder / ".venv").symlink_to(sys.prefix)
    if not (folder / ".venv" / "bin" / "pip").exists():
        pytest.skip("this Python has no pip beside it")
    monkeypatch.setattr(extras, "ROOT", folder)
    return folder


def test_the_extras_are_those_of_the_project():
    declared = PROJECT["optional-dependencies"]
    assert set(EXTRAS) == set(declared)
    for name, extra in EXTRAS.items():
        assert any(text.startswith(extra.package) for text in declared[name]), name


def test_in_the_clone_the_command_is_the_one_of_the_readme(clone, monkeypatch):
    monkeypatch.chdir(clone)
    assert install_command("video") == ".venv/bin/pip install -e '.[video]'"
    assert install_command() == ".venv/bin/pip install -e ."
    assert missing_text("video", "`video`").endswith("run: .venv/bin/pip install -e '.[video]'")


def test_elsewhere_the_command_names_this_python_and_the_clone(clone, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = shlex.split(install_command("video"))
    assert words == [sys.executable, "-m", "pip", "install", "-e", f"{clone}[video]"]


def test_a_wheel_has_no_clone_so_that_the_package_itself_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(extras, "ROOT", tmp_path)
    monkeypatch.chdir(tmp_path)
    assert shlex.split(install_command("rerun"))[1:] == ["-m", "pip", "install", "rerun-sdk"]


def test_a_module_that_is_missing_names_package_purpose_and_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingPackageError, match=r"^`video` needs av, which .* install -e .*\[video\]'$"):
        optional_module("av", "video", "`video`")


def test_the_doctor_lists_what_users_may_want_and_how_to_get_what_is_missing(monkeypatch):
    find = extras.importlib.util.find_spec
    monkeypatch.setattr(
        extras.importlib.util, "find_spec", lambda name: None if name == "av" else find("json")
    )
    findings = {each.subject: each for each in find_extras()}
    assert set(findings) == {f"extra {name}" for name, extra in EXTRAS.items() if extra.is_for_users}
    video = findings.pop("extra video")
    assert video.status == "note"
    assert "videos of runs" in video.found
    assert video.remedy == install_command("video")
    assert {each.status for each in findings.values()} == {"ok"}

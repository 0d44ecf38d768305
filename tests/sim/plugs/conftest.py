"""The folder of a user with plugs in it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from own_plugs import OWN_PLANNER, OWN_SENSOR


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

"""A small world for bounds: a ball with one small tumour, and 60 poses."""

from __future__ import annotations

import pytest
import trimesh
from campaign_plugs import BALL

from sim.cli.command_line import main


@pytest.fixture(scope="session")
def small_world(tmp_path_factory):
    """A scenario's file."""
    folder = tmp_path_factory.mktemp("world")
    trimesh.creation.icosphere(subdivisions=3, radius=0.05).export(folder / "ball.stl")
    (folder / "small.toml").write_text(BALL)
    return folder / "small.toml"


@pytest.fixture(scope="session")
def small_bound(small_world, tmp_path_factory):
    """The folder of a bound on that world."""
    out = tmp_path_factory.mktemp("bound") / "small"
    words = [
        "--scenario",
        str(small_world),
        "--seeds",
        "0:3",
        "--places",
        "20",
        "--jobs",
        "1",
        "--out",
        str(out),
    ]
    assert main(["bound", *words]) == 0
    return out

"""Meshes that cannot be used: one sentence each, whose remedy fits what is wrong."""

from __future__ import annotations

import re

import numpy as np
import pytest
import trimesh

from sim.world.errors import MeshError
from sim.world.meshes.meshes import load_mesh


def ball_mm(scale=1.0) -> trimesh.Trimesh:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=50.0)
    ball.vertices *= scale
    return ball


def figure_of_eight() -> trimesh.Trimesh:
    """A ball drawn through itself, so that its lower half is inside out."""
    ball = ball_mm()
    factor = ball.vertices[:, 2] / 50.0
    ball.vertices *= np.stack([factor, np.ones_like(factor), np.ones_like(factor)], axis=1)
    return ball


def stl(mesh: trimesh.Trimesh) -> bytes:
    return mesh.export(file_type="stl")


BAD = {
    "cut": (
        stl(ball_mm())[:30_000],
        "is cut short or no STL: by its header 1,280 triangles follow, and it ends after 30,000 bytes; copy or export "
        "it again",
    ),
    "words": (b"these are words " * 40, "is cut short or no STL"),
    "empty": (b"", "the file is empty; copy or export it again"),
    "point": (stl(ball_mm(0.0)), "all of its vertices are at one point; export the mesh again"),
    "metres": (stl(ball_mm(1e-3)), "if the file is in metres, pass `unit` m"),
    "eight": (stl(figure_of_eight()), "nor cross itself so that its parts cancel: remesh it"),
}


@pytest.mark.parametrize("name", BAD)
def test_the_remedy_fits_what_is_wrong(tmp_path, name) -> None:
    content, message = BAD[name]
    path = tmp_path / f"{name}.stl"
    path.write_bytes(content)
    with pytest.raises(MeshError, match=re.escape(str(path)) + ".*" + re.escape(message)):
        load_mesh(path)

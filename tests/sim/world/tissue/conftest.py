"""Organs that are pressed."""

import pytest
import trimesh
from pressed_bodies import HALF_HEIGHT_M, HALF_WIDTH_M, ball

from sim.world.anatomy.placement import lay_on_table
from sim.world.solids.solid import Solid


@pytest.fixture(scope="session")
def spheroid():
    """An ellipsoid of revolution of 600 ml on the table."""
    return ball([0.0, 0.0, HALF_HEIGHT_M], [HALF_WIDTH_M, HALF_WIDTH_M, HALF_HEIGHT_M], 5)


@pytest.fixture(scope="session")
def liver():
    """The embedded liver on the table."""
    mesh = trimesh.load("models/liver.stl")
    mesh.apply_scale(1e-3)
    return lay_on_table(Solid.from_trimesh(mesh)).organ

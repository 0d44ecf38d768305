"""What the coordinates of a mesh file mean: names that scenarios and command lines need before anything is loaded."""

from typing import Literal

Unit = Literal["mm", "m"]
"""Unit of a mesh's coordinates."""

METRES_PER_UNIT: dict[str, float] = {"mm": 1e-3, "m": 1.0}

MeshFrame = Literal["auto", "lps", "ras"]
"""Axes of a mesh: `auto` for what its header says, and LPS where it says nothing."""

"""How a patient's files may be coded: names alone, which the command line offers before anything is loaded."""

from typing import Literal

Unit = Literal["mm", "m"]
"""Unit of a mesh's coordinates."""

MeshFrame = Literal["auto", "lps", "ras"]
"""Axes of a mesh: `auto` for what its header says, else LPS."""

CodingName = Literal["auto", "lits", "msd-liver", "3d-ircadb", "totalsegmentator"]
"""What the numbers of a label volume mean."""

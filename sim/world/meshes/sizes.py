"""Sizes that organs and the bodies in them can have: what a wrong unit or spacing leads to is told, or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import MeshError
from sim.world.names import is_no_liver, meaning_of

from .coordinates import Unit

Role = Literal["organ", "tumour", "target"]

LARGEST_EXTENT_M = 2.0
"""No organ has a longer bounding box [m]; millimetres taken for metres always do."""

SMALLEST_EXTENT_M = {"organ": 0.03, "tumour": 0.0003, "target": 0.0003}
"""Shortest bounding boxes by their longest side [m]. The probe's head is 25 mm wide, so an organ that is hardly longer
has no surface to press it on; a liver in centimetres read as millimetres is shorter. Tumours in metres read as
millimetres are below theirs."""

LIVER_RANGE_M3 = (0.3e-3, 5.0e-3)
"""Human livers from a child's to a grossly enlarged one [m^3]; outside it the size is remarked on."""

ORGAN_RANGE_M3 = (5e-6, 5.0e-3)
"""Other organs, from an adrenal gland on [m^3]."""


def remarks_on_size(volume_m3: float, name: str) -> list[str]:
    """A remark, where an organ has a volume that it has in no patient.

    Args:
        volume_m3: Its volume [m^3].
        name: What a file calls the organ. One that names no organ may be a liver's.
    """
    low, high = ORGAN_RANGE_M3 if is_no_liver(name) else LIVER_RANGE_M3
    if low <= volume_m3 <= high:
        return []
    litres = f"a volume of {volume_m3 * 1e3:.3g} litres"
    bounds = f"({low * 1e3:g} to {high * 1e3:g})"
    remedy = "check the unit and the scan's voxel spacing"
    if is_no_liver(name):
        return [f"{litres} is implausible for a human organ such as {name!r} {bounds}; {remedy}"]
    if meaning_of(name) == "liver":
        return [f"{litres} is implausible for a human liver {bounds}; {remedy}"]
    return [f"{litres} is implausible if the organ is a human liver {bounds}; then {remedy}"]


def check_extent(path: Path, vertices_m: NDArray[np.float64], unit: Unit, role: Role) -> None:
    """Nothing, if a mesh is as long as what it stands for can be.

    Args:
        path: Its file, for messages.
        vertices_m: Its vertices [m], shape (V, 3).
        unit: The unit in which they were read.
        role: What it stands for.

    Raises:
        MeshError: It is not.
    """
    extent_m = float(np.ptp(vertices_m, axis=0).max())
    if extent_m > LARGEST_EXTENT_M:
        remedy = (
            "if the file is in millimetres, pass `unit` mm" if unit == "m" else "check the file's coordinates"
        )
        raise MeshError(
            f"{path}: its bounding box of {extent_m:.4g} m is above {LARGEST_EXTENT_M:g} m; {remedy}"
        )
    if extent_m == 0.0:
        raise MeshError(f"{path}: all of its vertices are at one point; export the mesh again")
    smallest_m = SMALLEST_EXTENT_M[role]
    if extent_m < smallest_m:
        raise MeshError(
            f"{path}: the bounding box of this {role} is {extent_m * 1e3:.3g} mm long, "
            f"below {smallest_m * 1e3:g} mm; {_remedy(extent_m, unit, smallest_m)}"
        )


def _remedy(extent_m: float, unit: Unit, smallest_m: float) -> str:
    """What to do about a mesh that is too small, by the unit in which it would not be."""
    if unit == "m":
        return "check the file's coordinates"
    if smallest_m <= extent_m * 1e3 <= LARGEST_EXTENT_M:
        return "if the file is in metres, pass `unit` m"
    return "if the file is in centimetres or inches, export it in millimetres"

"""How large a case's organ is, and how far its structures lie from it: what tells files of another unit or frame."""

from __future__ import annotations

import numpy as np

from sim.world.anatomy.structures import Structure
from sim.world.errors import AnatomyError
from sim.world.meshes.sizes import LARGEST_EXTENT_M, SMALLEST_EXTENT_M
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance, surface_distance_of

FAR_M = 0.05
"""A structure farther than this from the organ is seldom one of its own [m]."""

LARGEST_ORGAN_M3 = 0.03
"""No organ has a larger volume [m^3]: it is half of a person's."""

HALF_TURN = np.array([-1.0, -1.0, 1.0])
"""What turns RAS to LPS and back."""


def check_organ_extent(organ: Solid, name: str, remedy: str) -> None:
    """Nothing, if an organ has a size that a probe can be pressed on and a patient can have.

    Args:
        organ: The organ [m].
        name: What to call it in messages.
        remedy: What to do where it has not.

    Raises:
        AnatomyError: It has not.
    """
    if organ.volume_m3 > LARGEST_ORGAN_M3:
        raise AnatomyError(
            f"{name}: the organ has {organ.volume_m3 * 1e3:,.0f} litres, and no organ more than "
            f"{LARGEST_ORGAN_M3 * 1e3:g}; {remedy}"
        )
    extent_m = float(organ.extents_m.max())
    if not SMALLEST_EXTENT_M["organ"] <= extent_m <= LARGEST_EXTENT_M:
        raise AnatomyError(
            f"{name}: the organ is {extent_m * 1e3:.3g} mm long, and must be from "
            f"{SMALLEST_EXTENT_M['organ'] * 1e3:g} to {LARGEST_EXTENT_M * 1e3:g} mm; {remedy}"
        )


def remarks_on_distance(structures: tuple[Structure, ...], organ: Solid) -> list[str]:
    """A sentence on each structure that lies far from the organ.

    Args:
        structures: The structures, in the organ's frame.
        organ: The organ, patient axes [m].
    """
    remarks = []
    for each in structures:
        away_m = distance_m(organ, each.solid)
        if away_m <= FAR_M:
            continue
        turned = Solid(each.solid.vertices_m * HALF_TURN, each.solid.faces)
        turned_m = distance_m(organ, turned)
        what = ", so no pose is kept away from it" if each.is_keepout else ""
        remedy = (
            f"turned from RAS to LPS axes, or back, it would lie {turned_m * 1e3:.0f} mm from it: check the axes of "
            "both files (`mesh_frame`, `voxel_axes`)"
            if turned_m <= FAR_M
            else "check that both files are of one scan, and their unit and axes (`unit`, `mesh_frame`, `voxel_axes`)"
        )
        remarks.append(f"{each.name}: lies {away_m * 1e3:.0f} mm from the organ{what}; {remedy}")
    return remarks


def distance_m(organ: Solid, body: Solid) -> float:
    """The distance between an organ and another body [m], 0 where it lies in it; where near, by its vertices alone.

    Args:
        organ: The organ [m].
        body: The other.
    """
    if organ.contains(body.vertices_m).any():
        return 0.0
    away_m = float(surface_distance_of(organ).distance_m(body.vertices_m).min())
    if away_m <= FAR_M:
        return away_m
    return min(away_m, float(SurfaceDistance(body).distance_m(organ.vertices_m).min()))

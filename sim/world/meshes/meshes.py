"""Reading organ and tumour meshes from files: what leaves here is a closed, outward surface in metres."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import trimesh
from numpy.typing import NDArray

from sim.world.errors import MeshError, MissingPackageError
from sim.world.solids.solid import Solid

from .coordinates import METRES_PER_UNIT, MeshFrame, Unit
from .decimation import decimate
from .files import read_triangles
from .repair import RepairError, repair

Role = Literal["organ", "tumour", "target"]

LARGEST_EXTENT_M = 2.0
"""No organ has a longer bounding box [m]; millimetres taken for metres always do."""

SMALLEST_EXTENT_M = {"organ": 0.005, "tumour": 0.0003, "target": 0.0003}
"""No organ or segmented tumour, cyst or the like has a shorter one [m]; metres taken for millimetres always do."""

ORGAN_VOLUME_RANGE_M3 = (0.3e-3, 5.0e-3)
"""Human livers from a child's to a grossly enlarged one [m^3]; outside it the size is remarked on."""

FLAT_SHARE = 1e-6
"""A solid with a smaller share of its bounding box's diagonal cubed has no volume to speak of."""

LARGEST_REVERSED_SHARE = 0.01
"""Volume with a negative winding number that may hide in a usable solid, as a share of its volume."""

REMARKABLE_OVERLAP_SHARE = 0.01
"""Volume covered more than once that is worth a notice, as a share of the solid's volume."""

TEST_LATTICE = 32
"""Points per axis of the lattice on which the winding number is counted."""

MOST_TRIANGLES = 200_000
"""Meshes with more are simplified: finer ones cost minutes and change nothing that a probe could tell."""

SIMPLIFIED_TRIANGLES = 100_000
"""Triangles that remain then."""


@dataclass(frozen=True, eq=False)
class LoadedMesh:
    """A closed, outward mesh and what had to be said about it.

    Attributes:
        solid: The solid it bounds [m], in the frame of its file.
        notices: One sentence for each repair and for each remarkable property.
        name: The file's name.
    """

    solid: Solid
    notices: tuple[str, ...]
    name: str

    @property
    def mesh(self) -> trimesh.Trimesh:
        """The surface as a trimesh object [m], made anew at each call."""
        return self.solid.to_trimesh()


def load_mesh(
    path: str | Path, unit: Unit = "mm", *, role: Role = "organ", frame: MeshFrame = "auto"
) -> LoadedMesh:
    """A mesh file as a closed, outward solid in metres.

    Duplicate vertices and triangles are merged, small holes filled and inverted windings turned; each repair
    is mentioned in the notices.

    Args:
        path: An STL, OBJ, PLY, GLB or glTF file.
        unit: Unit of the file's coordinates, "mm" or "m".
        role: What the mesh stands for, "organ", "tumour" or "target": it decides which sizes are plausible.
        frame: Axes of the file; what is returned is LPS.

    Returns:
        The mesh and the notices.

    Raises:
        MeshError: The file cannot be read, or its mesh cannot be made a closed solid of a plausible size.
    """
    if unit not in METRES_PER_UNIT:
        raise MeshError(f"unit {unit!r} is not known; use one of {', '.join(get_args(Unit))}")
    if role not in SMALLEST_EXTENT_M:
        raise MeshError(f"role {role!r} is not known; use one of {', '.join(get_args(Role))}")
    path = Path(path)
    vertices, faces, notices = read_triangles(path, frame)
    vertices_m = vertices * METRES_PER_UNIT[unit]
    _check_extent(path, vertices_m, unit, role)
    try:
        vertices_m, faces, repairs = repair(vertices_m, faces)
    except RepairError as error:
        raise MeshError(f"{path}: {error}") from error
    vertices_m, faces, simplified = _simplified(vertices_m, faces)
    solid = Solid(vertices_m, faces)
    volume_m3 = solid.volume_m3
    _check_volume(path, solid, volume_m3)
    notices += [*repairs, *simplified, *_check_winding(path, solid), *remarks_on_size(volume_m3, role)]
    return LoadedMesh(solid, tuple(f"{path.name}: {notice}" for notice in notices), path.name)


def load_surface(path: str | Path, unit: Unit = "mm", *, frame: MeshFrame = "auto") -> LoadedMesh:
    """A mesh file as a surface in metres that need not be closed, such as a vessel tree.

    Args:
        path: An STL, OBJ, PLY, GLB or glTF file.
        unit: Unit of the file's coordinates.
        frame: Axes of the file; what is returned is LPS.

    Raises:
        MeshError: The file cannot be read, or is larger than any patient.
    """
    path = Path(path)
    vertices, faces, notices = read_triangles(path, frame)
    vertices_m = vertices * METRES_PER_UNIT[unit]
    _check_extent(path, vertices_m, unit, "tumour")
    try:
        vertices_m, faces, _ = repair(vertices_m, faces)
        vertices_m, faces, simplified = _simplified(vertices_m, faces)
        notices += simplified
    except RepairError:
        notices.append(
            "its surface is not closed, which a structure's need not be: distances are to the surface"
        )
    return LoadedMesh(Solid(vertices_m, faces), tuple(f"{path.name}: {text}" for text in notices), path.name)


def _simplified(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], list[str]]:
    """The surface with fewer triangles where it has very many, and what to say of it."""
    if len(faces) <= MOST_TRIANGLES:
        return vertices_m, faces, []
    try:
        simple = decimate(vertices_m, faces, SIMPLIFIED_TRIANGLES)
    except MissingPackageError as error:
        return vertices_m, faces, [f"{len(faces):,} triangles make everything slow, and {error}"]
    if simple is None:
        return vertices_m, faces, [f"{len(faces):,} triangles make everything slow; decimate the mesh"]
    return *simple, [f"{len(faces):,} triangles were simplified to {len(simple[1]):,}"]


def _check_extent(path: Path, vertices_m: NDArray[np.float64], unit: Unit, role: Role) -> None:
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
        remedy = "if the file is in metres, pass `unit` m" if unit == "mm" else "check the file's coordinates"
        raise MeshError(
            f"{path}: the bounding box of this {role} is {extent_m * 1e3:.3g} mm long, "
            f"below {smallest_m * 1e3:g} mm; {remedy}"
        )


def _check_volume(path: Path, solid: Solid, volume_m3: float) -> None:
    diagonal_m = float(np.linalg.norm(solid.extents_m))
    if not volume_m3 > FLAT_SHARE * diagonal_m**3:
        raise MeshError(
            f"{path}: encloses no volume ({volume_m3 * 1e6:.3g} ml in a box of diagonal "
            f"{diagonal_m * 1e3:.3g} mm); it must bound a solid, neither be a sheet nor cross itself so that its "
            "parts cancel: remesh it"
        )


def _check_winding(path: Path, solid: Solid) -> list[str]:
    """Notices on overlaps, after making sure that hardly any of the volume is inside out.

    A closed surface that does not cross itself has winding number 0 or 1 everywhere. Where it crosses itself,
    parts are covered twice or more, which still count as inside, or are inside out with a negative number,
    where "inside" loses its meaning. Both are measured on a lattice off the vertices' own planes.
    """
    ticks = (np.arange(TEST_LATTICE) + np.sqrt(2.0) - 1.0) / TEST_LATTICE
    points_m = solid.bounds_m[0] + solid.extents_m * np.stack(
        np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1
    ).reshape(-1, 3)
    winding = solid.winding(points_m)
    n_inside = max(int((winding > 0).sum()), 1)
    reversed_share = int((winding < 0).sum()) / n_inside
    if reversed_share > LARGEST_REVERSED_SHARE:
        raise MeshError(
            f"{path}: crosses itself so that {reversed_share:.0%} of its volume is inside out; "
            "remesh it (for instance as a voxel remesh in Blender or MeshLab)"
        )
    overlap_share = int((winding > 1).sum()) / n_inside
    if overlap_share > REMARKABLE_OVERLAP_SHARE:
        return [f"{overlap_share:.0%} of the volume is covered more than once and counts as inside"]
    return []


def remarks_on_size(volume_m3: float, role: Role) -> list[str]:
    """A remark, where no human liver has such a volume."""
    low, high = ORGAN_VOLUME_RANGE_M3
    if role == "organ" and not low <= volume_m3 <= high:
        return [
            f"a volume of {volume_m3 * 1e3:.3g} litres is implausible for a human liver "
            f"({low * 1e3:g} to {high * 1e3:g}); check the unit and the scan's voxel spacing"
        ]
    return []

"""Reading organ and tumour meshes from files: what leaves here is a closed, outward surface in metres."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

import numpy as np
import trimesh
from numpy.typing import NDArray

from sim.world.errors import MeshError
from sim.world.names import fold, meaning_of
from sim.world.solids.solid import Solid

from .bodies import organ_bodies, separate_solids
from .coordinates import METRES_PER_UNIT, MeshFrame, Unit
from .decimation import decimate
from .files import ReadMesh, read_triangles
from .objects import MeshObject, SortedObjects, joined, sort_bodies, sort_objects, told_apart
from .pieces import PieceError, is_piece_name
from .repair import RepairError, repair
from .sizes import SMALLEST_EXTENT_M, Role, check_extent, remarks_on_size

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
        tumours: Objects of the organ's file that are tumours by their names.
        structures: Objects of the organ's file that are shown beside it, by name.
    """

    solid: Solid
    notices: tuple[str, ...]
    name: str
    tumours: tuple[Solid, ...] = ()
    structures: Mapping[str, Solid] = field(default_factory=dict)

    @property
    def mesh(self) -> trimesh.Trimesh:
        """The surface as a trimesh object [m], made anew at each call."""
        return self.solid.to_trimesh()


def load_mesh(
    path: str | Path,
    unit: Unit = "mm",
    *,
    role: Role = "organ",
    frame: MeshFrame = "auto",
    organ_object: str | None = None,
) -> LoadedMesh:
    """A mesh file as a closed, outward solid in metres.

    Duplicate vertices and triangles are merged, small holes filled and inverted windings turned; each repair
    is mentioned in the notices. Of an organ's file the object that is the organ is taken, and of it the bodies that
    lie together; the notices say what the rest is taken for.

    Args:
        path: An STL, OBJ, PLY, GLB or glTF file.
        unit: Unit of the file's coordinates, "mm" or "m".
        role: What the mesh stands for, "organ", "tumour" or "target": it decides which sizes are plausible.
        frame: Axes of the file; what is returned is LPS.
        organ_object: Name of the object that is the organ, or `piece 2` for the second largest of its bodies; None to
            take the one that is meant.

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
    read = read_triangles(path, frame)
    vertices_m, faces, notices = read.vertices * METRES_PER_UNIT[unit], read.faces, read.remarks
    check_extent(path, vertices_m, unit, role)
    try:
        found = _sorted_objects(read, unit, organ_object, role)
        if found is not None:
            vertices_m, faces = joined(found.organ if role == "organ" else found.tumours)
            notices.append(found.remark)
        vertices_m, faces, repairs = repair(vertices_m, faces)
        if role == "organ":
            vertices_m, faces, said = organ_bodies(vertices_m, faces, _piece(organ_object, found, read))
            repairs += said
    except (RepairError, PieceError) as error:
        raise MeshError(f"{path}: {error}") from error
    solid, simplified = _checked_solid(path, vertices_m, faces)
    notices += [*repairs, *simplified, *_check_winding(path, solid)]
    if role == "organ":
        notices += remarks_on_size(solid.volume_m3, found.organ[0].name if found else _called(path, read))
    return LoadedMesh(
        solid,
        tuple(f"{path.name}: {notice}" for notice in notices),
        path.name,
        tumours=tuple(_solid_of(each) for each in (found.tumours if found and role == "organ" else ())),
        structures={each.name: _solid_of(each) for each in (found.structures if found else ())},
    )


def load_bodies(
    path: str | Path, unit: Unit = "mm", *, role: Role = "tumour", frame: MeshFrame = "auto"
) -> tuple[tuple[Solid, ...], tuple[str, ...]]:
    """The separate bodies of a mesh file of tumours or targets, the largest first, and notices.

    Args:
        path: An STL, OBJ, PLY, GLB or glTF file.
        unit: Unit of the file's coordinates.
        role: What each body is.
        frame: Axes of the file; what is returned is LPS.

    Raises:
        MeshError: The file cannot be read, or its mesh cannot be made a closed solid of a plausible size.
    """
    mesh = load_mesh(path, unit, role=role, frame=frame)
    solids, said = separate_solids(mesh.solid, role)
    return solids, (*mesh.notices, *(f"{mesh.name}: {text}" for text in said))


def _sorted_objects(read: ReadMesh, unit: Unit, organ_object: str | None, role: Role) -> SortedObjects | None:
    """What the objects of a file are; None where they are one surface.

    Raises:
        PieceError: Several could be the organ, or the one wanted is not there.
    """
    scaled = [replace(each, vertices=each.vertices * METRES_PER_UNIT[unit]) for each in read.objects]
    units = told_apart(scaled) if len(scaled) > 1 else []
    if len(units) < 2:
        return None
    if role != "organ":
        return sort_bodies(units, role)
    is_of_pieces = organ_object is not None and is_piece_name(organ_object)
    return sort_objects(units, None if is_of_pieces else organ_object)


def _piece(organ_object: str | None, found: SortedObjects | None, read: ReadMesh) -> str | None:
    """The name of the body to take of an organ, None for the rule."""
    if organ_object is None or is_piece_name(organ_object):
        return organ_object
    is_only_one = found is None and fold(organ_object) in map(fold, read.names)
    return None if found is not None or is_only_one else organ_object


def _called(path: Path, read: ReadMesh) -> str:
    """What a file of one object calls it, or what the file is called where that tells more."""
    return next((name for name in (*read.names, path.name.split(".")[0]) if meaning_of(name)), path.name)


def _solid_of(body: MeshObject) -> Solid:
    return Solid(body.vertices, body.faces)


def _checked_solid(
    path: Path, vertices_m: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[Solid, list[str]]:
    """The solid with few enough triangles, and what is said of that."""
    vertices_m, faces, simplified = _simplified(vertices_m, faces)
    solid = Solid(vertices_m, faces)
    _check_volume(path, solid, solid.volume_m3)
    return solid, simplified


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
    read = read_triangles(path, frame)
    vertices_m, faces, notices = read.vertices * METRES_PER_UNIT[unit], read.faces, read.remarks
    check_extent(path, vertices_m, unit, "tumour")
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
    simple = decimate(vertices_m, faces, SIMPLIFIED_TRIANGLES)
    if simple is None:
        return vertices_m, faces, [f"{len(faces):,} triangles make everything slow; decimate the mesh"]
    return *simple, [f"{len(faces):,} triangles were simplified to {len(simple[1]):,}"]


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

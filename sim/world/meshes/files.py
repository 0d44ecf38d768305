"""Triangles from mesh files, as the file has them: vertices in its unit and indices, in patient axes."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from sim.world.errors import MeshError
from sim.world.memory import spare_bytes
from sim.world.text import decoded

from .coordinates import MeshFrame
from .gltf_files import GltfError, PercentResolver, readable_gltf
from .objects import MeshObject, obj_text_by_object, objects_of_scene
from .repair import compact
from .stl_files import StlError, read_stl

FORMATS = (".stl", ".obj", ".ply", ".glb", ".gltf")

FILE_BYTES_PER_TRIANGLE = {".stl": 50, ".obj": 50}
"""Of a binary STL and of OBJ's text; other formats share vertices among triangles and take less."""

LEAST_FILE_BYTES_PER_TRIANGLE = 18
"""Of those other formats."""

BYTES_PER_TRIANGLE = 850
"""Memory that reading, closing and simplifying a mesh takes at its peak, as measured on 2 million triangles."""

HEADER_BYTES = 400
"""Where 3D Slicer writes SPACE=LPS or SPACE=RAS into the files it saves."""

READER_ERRORS = (
    *(ValueError, TypeError, LookupError, ArithmeticError, AttributeError, AssertionError, RuntimeError),
    *(NameError, ImportError, OSError, EOFError, MemoryError),
)
"""What a reader may raise on arbitrary bytes; ImportError where it needs a package to guess an encoding."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadMesh:
    """What a mesh file holds, in its unit and in LPS axes.

    Attributes:
        vertices: Vertices that faces use, shape (V, 3).
        faces: Vertex indices, at least one row, shape (F, 3).
        objects: The same triangles by the objects that the file names, where there are several.
        names: Names of all objects, one only included.
        remarks: One phrase for each remarkable property.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    objects: tuple[MeshObject, ...] = ()
    names: tuple[str, ...] = ()
    remarks: list[str] = field(default_factory=list)


def read_triangles(path: Path, frame: MeshFrame) -> ReadMesh:
    """The triangles of a mesh file.

    Args:
        path: An STL, OBJ, PLY, GLB or glTF file.
        frame: Axes of the file; `auto` for what its header says, and LPS where it says nothing.

    Raises:
        MeshError: The file holds no triangles in space.
    """
    read, content = _read(path)
    remarks = list(read.remarks)
    is_ras = frame == "ras"
    if frame == "auto" and re.search(rb"SPACE\s*=\s*RAS", content[:HEADER_BYTES]):
        is_ras = True
        remarks.append("its header says RAS axes, which were turned to LPS")
    # It is half a turn about z, which changes no triangle's side.
    turn = np.array([-1.0, -1.0, 1.0]) if is_ras else None
    vertices, objects = read.vertices, read.objects
    if turn is not None:
        vertices = vertices * turn
        objects = tuple(replace(each, vertices=each.vertices * turn) for each in objects)
    return replace(read, vertices=vertices, objects=objects, remarks=remarks)


def _read(path: Path) -> tuple[ReadMesh, bytes]:
    """The triangles in the file's own axes, and its bytes."""
    _check_is_mesh(path)
    _check_memory(path)
    try:
        content = path.read_bytes()
        if content.startswith(b"\x1f\x8b"):
            raise MeshError(f"{path}: is packed by gzip; unpack it first (gunzip)")
        with _quiet_reader():
            read = _read_stl(content) if path.suffix.lower() == ".stl" else _read_by_trimesh(path, content)
    except MeshError:
        raise
    except (StlError, GltfError) as error:
        raise MeshError(f"{path}: {error}") from error
    except READER_ERRORS as error:
        raise MeshError(
            f"{path}: cannot be read as {path.suffix[1:].upper()} "
            f"({type(error).__name__}: {_first_line(error)}); export the mesh again"
        ) from error
    vertices, faces = _checked(path, content, read.vertices, read.faces)
    return replace(read, vertices=vertices, faces=faces), content


def _check_is_mesh(path: Path) -> None:
    """Nothing, if a path is that of a file of a format that is read.

    Raises:
        MeshError: It is not.
    """
    if path.is_dir():
        raise MeshError(f"{path}: is a folder; name the file in it")
    if not path.is_file():
        raise MeshError(f"{path}: there is no such file; check the path")
    if path.suffix.lower() not in FORMATS:
        raise MeshError(
            f"{path}: format {path.suffix!r} is not read; convert to one of {', '.join(FORMATS)} (3D Slicer, MeshLab "
            "and Blender save them), or give a label volume as .nii.gz or .nrrd"
        )


def _read_stl(content: bytes) -> ReadMesh:
    solids, remarks = read_stl(content)
    corners = np.concatenate([np.empty((0, 3, 3)), *(each.corners for each in solids)])
    objects = [
        MeshObject(name=each.name, vertices=each.corners.reshape(-1, 3), faces=_in_order(len(each.corners)))
        for each in solids
    ]
    return ReadMesh(
        vertices=corners.reshape(-1, 3),
        faces=_in_order(len(corners)),
        objects=tuple(objects) if len(objects) > 1 else (),
        names=tuple(each.name for each in solids),
        remarks=remarks,
    )


def _in_order(n: int) -> NDArray[np.int64]:
    """Faces of triangles that share no vertices, shape (n, 3)."""
    return np.arange(3 * n).reshape(-1, 3)


def _read_by_trimesh(path: Path, content: bytes) -> ReadMesh:
    kind, resolver = path.suffix.lower()[1:], None
    by_object, order, names = "", [], ()
    if kind == "obj":
        # OBJ is text, whose comments may be in any encoding.
        text = decoded(content)
        by_object, order, names = obj_text_by_object(text)
        content = text.encode()
    elif kind in ("glb", "gltf"):
        kind, content = readable_gltf(path, content)
        resolver = PercentResolver(str(path))
    scene = trimesh.load_scene(BytesIO(content), file_type=kind, process=False, resolver=resolver)
    mesh = scene.to_mesh()
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    if order:
        scene = trimesh.load_scene(
            BytesIO(by_object.encode()),
            file_type=kind,
            process=False,
            split_objects=True,
            group_material=False,
        )
    objects = objects_of_scene(scene, order) if kind != "ply" else []
    return ReadMesh(
        vertices=vertices,
        faces=faces,
        objects=tuple(objects) if len(objects) > 1 else (),
        names=(*names, *(each.name for each in objects)),
    )


def _checked(
    path: Path, content: bytes, vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The vertices that faces use, and the faces over these.

    Raises:
        MeshError: They are no triangles in space, or there is none.
    """
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or faces.ndim != 2 or faces.shape[1:] != (3,):
        raise MeshError(f"{path}: holds no triangles in space; export a surface of triangles")
    if len(faces) == 0:
        if not content:
            raise MeshError(f"{path}: the file is empty; copy or export it again")
        raise MeshError(f"{path}: holds no triangles; export the surface, not only its points")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError(f"{path}: triangles name vertices that the file does not hold; export the mesh again")
    vertices, faces = compact(vertices, faces)
    n_bad = int((~np.isfinite(vertices).all(axis=1)).sum())
    if n_bad:
        raise MeshError(
            f"{path}: {n_bad} of {len(vertices)} vertices are NaN or infinite; export the mesh again"
        )
    return vertices, faces


def _check_memory(path: Path) -> None:
    """Nothing, unless a file is so large that its triangles would not fit into memory.

    Raises:
        MeshError: It is.
    """
    size = path.stat().st_size
    per_triangle = FILE_BYTES_PER_TRIANGLE.get(path.suffix.lower(), LEAST_FILE_BYTES_PER_TRIANGLE)
    need, spare = size / per_triangle * BYTES_PER_TRIANGLE, spare_bytes()
    if need > spare:
        raise MeshError(
            f"{path}: its {size / 2**20:,.0f} MiB may hold {size / per_triangle / 1e6:.3g} million triangles, which "
            f"take {need / 2**30:.3g} GiB, more than the {spare / 2**30:.2g} GiB that this machine can spare; decimate "
            "the mesh to some 100,000 triangles"
        )


@contextmanager
def _quiet_reader() -> Iterator[None]:
    """Keeps the reader from printing tracebacks of what it tried; the error that is raised says it better."""
    logger = logging.getLogger("trimesh")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [""])[0][:120]

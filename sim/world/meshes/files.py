"""Triangles from mesh files, as the file has them: vertices in its unit and indices, in patient axes."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.resolvers import FilePathResolver

from sim.world.errors import MeshError
from sim.world.memory import spare_bytes

from .coordinates import MeshFrame
from .repair import compact

FORMATS = (".stl", ".obj", ".ply", ".glb", ".gltf")

FILE_BYTES_PER_TRIANGLE = {".stl": 50, ".obj": 50}
"""Of a binary STL and of OBJ's text; other formats share vertices among triangles and take less."""

LEAST_FILE_BYTES_PER_TRIANGLE = 18
"""Of those other formats."""

BYTES_PER_TRIANGLE = 850
"""Memory that reading, closing and simplifying a mesh takes at its peak, as measured on 2 million triangles."""

STL_HEADER_BYTES = 84
"""Of a binary STL; the last four are the number of its triangles."""

HEADER_BYTES = 400
"""Where 3D Slicer writes SPACE=LPS or SPACE=RAS into the files it saves."""

READER_ERRORS = (
    *(ValueError, TypeError, LookupError, ArithmeticError, AttributeError, AssertionError, RuntimeError),
    *(NameError, ImportError, OSError, EOFError, MemoryError),
)
"""What a reader may raise on arbitrary bytes; ImportError where it needs a package to guess an encoding."""


def read_triangles(path: Path, frame: MeshFrame) -> tuple[NDArray[np.float64], NDArray[np.int64], list[str]]:
    """Vertices in the file's unit and LPS axes, faces, of which there is at least one, and remarks.

    Args:
        path: An STL, OBJ, PLY, GLB or glTF file.
        frame: Axes of the file; `auto` for what its header says, and LPS where it says nothing.

    Raises:
        MeshError: The file holds no triangles in space.
    """
    vertices, faces, content = _read(path)
    remarks: list[str] = []
    is_ras = frame == "ras"
    if frame == "auto" and re.search(rb"SPACE\s*=\s*RAS", content[:HEADER_BYTES]):
        is_ras = True
        remarks.append("its header says RAS axes, which were turned to LPS")
    if is_ras:
        # It is half a turn about z, which changes no triangle's side.
        vertices = vertices * [-1.0, -1.0, 1.0]
    return vertices, faces, remarks


def _read(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], bytes]:
    kind = path.suffix.lower()
    if not path.is_file():
        raise MeshError(f"{path}: there is no such file; check the path")
    if kind not in FORMATS:
        raise MeshError(f"{path}: format {path.suffix!r} is not read; convert to one of {', '.join(FORMATS)}")
    _check_memory(path)
    try:
        content = path.read_bytes()
        # OBJ is text, whose comments may be in any encoding.
        text = content.decode("utf-8", errors="replace").encode() if kind == ".obj" else content
        resolver = FilePathResolver(str(path)) if kind == ".gltf" else None
        with _quiet_reader():
            mesh = trimesh.load_mesh(BytesIO(text), file_type=kind[1:], process=False, resolver=resolver)
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    except READER_ERRORS as error:
        raise MeshError(
            f"{path}: cannot be read as {path.suffix[1:].upper()} "
            f"({type(error).__name__}: {_first_line(error)}); export the mesh again"
        ) from error
    vertices, faces = _checked(path, content, vertices, faces)
    return vertices, faces, content


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
        _check_whole(path, content)
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


def _check_whole(path: Path, content: bytes) -> None:
    """Nothing, unless a file that holds no triangles is empty, or an STL cut short.

    Raises:
        MeshError: It is.
    """
    if not content:
        raise MeshError(f"{path}: the file is empty; copy or export it again")
    if path.suffix.lower() != ".stl" or content.lstrip().startswith(b"solid"):
        return
    n = int.from_bytes(content[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")
    if len(content) < STL_HEADER_BYTES + n * FILE_BYTES_PER_TRIANGLE[".stl"]:
        raise MeshError(
            f"{path}: is cut short or no STL: by its header {n:,} triangles follow, and it ends after "
            f"{len(content):,} bytes; copy or export it again"
        )


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

"""NRRD files, the header by pynrrd: the voxels are unpacked to the size that the header names and not a byte more."""

from __future__ import annotations

import bz2
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import nrrd
import numpy as np
from nrrd.reader import _determine_datatype
from numpy.typing import NDArray

from sim.world.text import decoded

from .grid import METRES_PER_UNIT, Grid
from .nrrd_segments import Segment, in_parts, layers_of, segments_of

CHUNK_BYTES = 1 << 20
"""Packed bytes that are read at once."""

MOST_HEADER_BYTES = 16 << 20
"""No header is longer: thousands of segments take some hundred bytes each."""

MOST_TOLD = 12
"""Segments that a notice names."""

LPS_SIGNS = {
    "left-posterior-superior": (1, 1, 1),
    "lps": (1, 1, 1),
    "right-anterior-superior": (-1, -1, 1),
    "ras": (-1, -1, 1),
    "left-anterior-superior": (1, -1, 1),
    "las": (1, -1, 1),
}
"""What turns the axes of a header's space to LPS."""


def read_nrrd(path: Path) -> Grid:
    """The grid of a .nrrd or .nhdr file. No voxel is read before the grid's layers are taken.

    Raises:
        ValueError: The header lacks a field, or contradicts itself. pynrrd raises errors of its own on others.
    """
    with path.open("rb") as file:
        header = nrrd.read_header(_header_lines(file))
        start = file.tell()
    missing = [key for key in ("dimension", "type", "encoding", "sizes") if key not in header]
    if missing:
        raise ValueError(f"the header lacks {', '.join(missing)}")
    dtype = np.dtype(_determine_datatype(header))
    shape = tuple(int(n) for n in header["sizes"])
    if len(shape) != int(header["dimension"]):
        raise ValueError(f"{len(shape)} sizes are given for {header['dimension']} dimensions")
    T, notices = _affine(header, len(shape))
    n_bytes = int(np.prod([max(n, 0) for n in shape], dtype=object)) * dtype.itemsize
    segments, layer_axis = segments_of(header), _layer_axis(header, shape)
    grid = Grid(
        shape=shape,
        dtype=dtype,
        T_lps_voxel=T,
        layers=lambda n: _parts(np.frombuffer(_payload(path, header, start, n_bytes), dtype), shape, n),
        notices=notices,
        label_names={each.value: each.name for each in segments if each.name},
        is_compressed=str(header["encoding"]).lower() not in ("raw",),
    )
    if layer_axis is None:
        return grid
    return _layered(grid, segments, layer_axis) if segments else _without_axis(grid, layer_axis)


def _layer_axis(header: dict[str, Any], shape: tuple[int, ...]) -> int | None:
    """The axis of a file of four along which layers follow each other; None where there is none."""
    if len(shape) != 4:
        return None
    kinds = [str(kind).lower() for kind in header.get("kinds") or ()]
    rows = header.get("space directions")
    for axis in range(4):
        is_none = rows is not None and (rows[axis] is None or not np.isfinite(rows[axis]).all())
        if is_none or (len(kinds) == 4 and kinds[axis] in ("list", "vector", "none", "???")):
            return axis
    return None


def _without_axis(grid: Grid, axis: int) -> Grid:
    """The grid without an axis of a single entry; as it was, if it has more."""
    if grid.shape[axis] != 1:
        return grid
    space, read_all = tuple(n for each, n in enumerate(grid.shape) if each != axis), grid.layers
    return replace(grid, shape=space, layers=lambda n: _parts(next(read_all(0)), space, n))


def _layered(grid: Grid, segments: list[Segment], layer_axis: int) -> Grid:
    """The grid of a file whose segments lie on layers, in which each voxel has one number."""
    layers = layers_of(segments, grid.shape[layer_axis])
    space = tuple(n for axis, n in enumerate(grid.shape) if axis != layer_axis)
    read_all = grid.layers

    def combined(thickness: int) -> Iterator[NDArray[Any]]:
        whole = next(read_all(0)).reshape(grid.shape, order="F")
        return in_parts(whole, layers, thickness, layer_axis)

    if layers.is_renumbered:
        told = ", ".join(f"{label} {name!r}" for label, name in list(layers.names.items())[:MOST_TOLD])
        grid.notices.append(
            f"its segments lie on {grid.shape[layer_axis]} layers and are numbered anew: {told}"
        )
    return replace(
        grid,
        shape=space,
        dtype=np.dtype(np.uint16),
        bytes_per_voxel=grid.dtype.itemsize * grid.shape[layer_axis],
        layers=combined,
        label_names=layers.names,
        overlaps=layers.overlaps,
    )


def _header_lines(file: BinaryIO) -> list[str]:
    """The lines of a header up to the blank one that ends it, where the file is then left.

    Raises:
        ValueError: The first line is not that of an NRRD file, or the header does not end.
    """
    lines = [decoded(file.readline(MOST_HEADER_BYTES))]
    if not lines[0].startswith("NRRD"):
        raise ValueError("the first bytes are not those of an NRRD header")
    n_bytes = 0
    while lines[-1].strip():
        line = file.readline(MOST_HEADER_BYTES)
        n_bytes += len(line)
        if n_bytes >= MOST_HEADER_BYTES:
            raise ValueError(f"the header does not end within {MOST_HEADER_BYTES:,} bytes")
        lines.append(decoded(line))
    return lines


def _affine(header: dict[str, Any], n_axes: int) -> tuple[NDArray[np.float64], list[str]]:
    """The map of voxel indices to LPS metres, of the first three axes that lie in space, and notices."""
    notices: list[str] = []
    space = str(header.get("space", "")).lower().replace(" ", "-")
    if space not in LPS_SIGNS:
        notices.append(
            "the header names no patient axes that are known; LPS is assumed, as in ITK and 3D Slicer, so that the map "
            "will lie on the scan there: check left and right"
        )
    flip = np.diag(np.array(LPS_SIGNS.get(space, (1, 1, 1)), dtype=np.float64))
    unit = METRES_PER_UNIT.get(str((header.get("space units") or ["mm"])[0]), 1e-3)
    T = np.eye(4)
    if header.get("space directions") is not None:
        rows = [row for row in header["space directions"] if row is not None and np.isfinite(row).all()]
        directions = np.array(rows, dtype=np.float64)
        if directions.shape != (3, 3):
            raise ValueError(f"{len(rows)} directions in space are given; three are needed")
        T[:3, :3] = flip @ directions.T * unit
    else:
        spacings = np.asarray(header.get("spacings", np.ones(n_axes)), dtype=np.float64)[:3]
        T[:3, :3] = flip @ np.diag(spacings) * unit
        if "spacings" not in header:
            notices.append(
                "the header gives no spacing; 1 mm is assumed: pass `spacing_mm` X Y Z if it is not"
            )
        T[:3, 3] = flip @ _first_voxel(header, spacings) * unit
        return T, notices
    origin = np.asarray(header.get("space origin", np.zeros(3)), dtype=np.float64)
    T[:3, 3] = flip @ origin * unit
    return T, notices


def _first_voxel(header: dict[str, Any], spacings: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the middle of the first voxel lies in a header without directions, in its unit, shape (3,)."""
    if header.get("space origin") is not None:
        return np.asarray(header["space origin"], dtype=np.float64)
    lows = header.get("axis mins", header.get("axismins"))
    if lows is None or not np.isfinite(lows[:3]).all():
        return np.zeros(3)
    # A cell begins half a step before its middle; a node is its own middle. Without a word they are cells.
    kinds = [str(kind).lower() for kind in header.get("centerings", ())] + ["cell"] * 3
    is_cell = np.array([kind != "node" for kind in kinds[:3]])
    return np.asarray(lows, dtype=np.float64)[:3] + np.where(is_cell, 0.5 * spacings, 0.0)


def _parts(values: NDArray[Any], shape: tuple[int, ...], n: int) -> Iterator[NDArray[Any]]:
    """Voxels that are in memory, in parts of `n` layers; all of them in a row for 0."""
    if n == 0:
        yield values
        return
    whole = values.reshape(tuple(size for axis, size in enumerate(shape) if axis < 3 or size != 1), order="F")
    for first in range(0, whole.shape[2], n):
        yield whole[:, :, first : first + n]


def _payload(path: Path, header: dict[str, Any], start: int, n_bytes: int) -> bytearray:
    """The voxels of an NRRD file.

    Args:
        path: The file with the header.
        header: Its fields.
        start: Where the header ends, and attached voxels begin.
        n_bytes: How many bytes the voxels take unpacked.

    Raises:
        ValueError: The voxels are spread over several files, lie elsewhere, or are packed in a way that is not read.
        EOFError: The file ends early.
    """
    skips = [int(header.get(key, header.get(key.replace(" ", ""), 0))) for key in ("line skip", "byte skip")]
    if skips != [0, 0]:
        raise ValueError("its voxels are preceded by lines or bytes to skip; save it with an attached header")
    if (detached := _detached(path, header)) is not None:
        path, start = detached, 0
    encoding = str(header["encoding"]).lower()
    with path.open("rb") as file:
        file.seek(start)
        if encoding == "raw":
            return _exactly(bytearray(file.read(n_bytes)), n_bytes)
        if encoding in ("gzip", "gz"):
            return _unpack(file, zlib.decompressobj(zlib.MAX_WBITS | 16), n_bytes)
        if encoding in ("bzip2", "bz2"):
            return _unpack(file, bz2.BZ2Decompressor(), n_bytes)
    raise ValueError(f"encoding {encoding[:20]!r} is not read; save it as raw or gzip")


def voxel_file(path: Path) -> Path:
    """The file that holds the voxels: the header's own, or another beside it.

    Raises:
        ValueError: They are spread over several files, or lie elsewhere. pynrrd raises errors of its own on others.
    """
    with path.open("rb") as file:
        header = nrrd.read_header(_header_lines(file))
    return _detached(path, header) or path


def _detached(path: Path, header: dict[str, Any]) -> Path | None:
    """The file beside the header that holds the voxels; None where they follow it."""
    detached = header.get("data file", header.get("datafile"))
    if detached is None:
        return None
    name = Path(str(detached))
    if name.is_absolute() or len(name.parts) != 1 or "%" in name.name or name.name == "LIST":
        raise ValueError(f"its voxels are in {str(detached)[:60]!r}; keep header and one data file together")
    return path.parent / name


def _unpack(file: BinaryIO, packed: Any, n_bytes: int) -> bytearray:
    """What a stream unpacks to, at most `n_bytes`."""
    content, rest = bytearray(), b""
    while len(content) < n_bytes and not packed.eof:
        chunk = rest or (file.read(CHUNK_BYTES) if getattr(packed, "needs_input", True) else b"")
        if not chunk and getattr(packed, "needs_input", True):
            break
        content += packed.decompress(chunk, min(CHUNK_BYTES * 16, n_bytes - len(content)))
        rest = getattr(packed, "unconsumed_tail", b"")
    return _exactly(content, n_bytes)


def _exactly(content: bytearray, n_bytes: int) -> bytearray:
    if len(content) < n_bytes:
        raise EOFError(f"{len(content):,} of {n_bytes:,} bytes of voxels are there")
    return content

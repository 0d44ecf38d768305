"""Packing: arrays as one compressed text that a page can hold, and a table of where each of them begins."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .creases import creased

ALIGNMENT = 8
"""Arrays begin at multiples of this many bytes, as JavaScript's typed arrays have to."""
LEVEL = 6


class Pack:
    """A collection of arrays, each of which is known by what `add` returns."""

    def __init__(self) -> None:
        """Begin empty."""
        self._chunks: list[bytes] = []
        self._size = 0

    def add(self, array: NDArray[Any]) -> dict[str, Any]:
        """The place of an array that is taken in: its kind, offset in bytes and length in numbers."""
        little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
        content = little.tobytes()
        place = {"kind": array.dtype.name, "at": self._size, "n": int(array.size)}
        padding = -len(content) % ALIGNMENT
        self._chunks += [content, bytes(padding)]
        self._size += len(content) + padding
        return place

    def text(self) -> str:
        """All arrays as one compressed text in base64."""
        return base64.b64encode(zlib.compress(b"".join(self._chunks), LEVEL)).decode("ascii")


def add_mesh(pack: Pack, vertices_m: ArrayLike, faces: ArrayLike) -> dict[str, Any]:
    """The place of a triangle mesh that a pack takes in, with the normals to light it by.

    Args:
        pack: The pack.
        vertices_m: Vertices [m], shape (V, 3); they are kept to 1/65535 of the box around them.
        faces: Triangles, shape (F, 3).

    Returns:
        The box, and where the arrays lie.
    """
    vertices, triangles = np.asarray(vertices_m, dtype=np.float64), np.asarray(faces)
    vertices, normals, triangles = creased(vertices, triangles)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    scale = np.where(high > low, high - low, 1.0)
    fine = np.rint((vertices - low) / scale * 65535).astype(np.uint16)
    kind = np.uint16 if len(vertices) <= 65535 else np.uint32
    return {
        "low": low.tolist(),
        "scale": (scale / 65535).tolist(),
        "vertices": pack.add(fine.ravel()),
        "normals": pack.add(np.rint(normals * 127).astype(np.int8).ravel()),
        "faces": pack.add(triangles.astype(kind).ravel()),
    }

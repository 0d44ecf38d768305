"""glTF and GLB files: what is checked and turned before trimesh reads them.

Compressed geometry cannot be read and is refused by name. Quantised positions (KHR_mesh_quantization) are whole
numbers that stand for fractions; they are written out as floating-point numbers, which every reader knows. A buffer's
address is percent-encoded, as `liver%20left.bin`.
"""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from trimesh.resolvers import FilePathResolver

from sim.world.text import decoded

GLB_MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", b"JSON", b"BIN\0"

COMPRESSED = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
"""Extensions that pack the triangles so that they are not read here."""

HARMLESS = ("material", "texture", "light", "variant", "xmp", "animation")
"""Words in the names of extensions that change no triangle."""

QUANTISED = "KHR_mesh_quantization"

WHOLE_NUMBERS: dict[int, tuple[str, float]] = {
    5120: ("<i1", 127.0),
    5121: ("<u1", 255.0),
    5122: ("<i2", 32767.0),
    5123: ("<u2", 65535.0),
}
"""Types of quantised positions, and what stands for 1 where they are normalised."""

FLOAT_TYPE = 5126


class GltfError(ValueError):
    """What of a glTF file is not read, and the remedy."""


def readable_gltf(path: Path, content: bytes) -> tuple[str, bytes]:
    """The file's kind, `glb` or `gltf`, and its bytes, with quantised positions as floating-point numbers.

    Args:
        path: A .glb or .gltf file, beside which its buffers lie.
        content: All bytes of the file.

    Raises:
        GltfError: Its triangles are compressed, or a buffer is not there.
        ValueError: The file is damaged.
    """
    is_binary = content.startswith(GLB_MAGIC)
    tree, binary = _chunks(content) if is_binary else (json.loads(decoded(content)), b"")
    if not isinstance(tree, dict):
        raise ValueError("its JSON is no object")
    _check_extensions(tree)
    resolver = PercentResolver(str(path))
    _check_buffers(tree, resolver, path)
    if not _quantised(tree):
        return ("glb", content) if is_binary else ("gltf", decoded(content).encode())
    buffers = [_buffer(each, resolver, binary) for each in tree["buffers"]]
    for index in _quantised(tree):
        buffers.append(_write_out(tree, tree["accessors"][index], buffers))
    for each, data in zip(tree["buffers"], buffers, strict=True):
        each["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    return "gltf", json.dumps(tree).encode()


class PercentResolver(FilePathResolver):
    """Finds the files that a glTF file names by percent-encoded addresses."""

    def get(self, name: str) -> bytes:
        """The bytes of a file beside the glTF file.

        Raises:
            OSError: There is none of that name.
        """
        try:
            return super().get(unquote(name))
        except OSError:
            # Some exporters write the plain name, in which a % is a letter like any other.
            return super().get(name)


def _chunks(content: bytes) -> tuple[Any, bytes]:
    """The JSON and the binary chunk of a GLB file."""
    found: dict[bytes, bytes] = {}
    start = 12
    while start + 8 <= len(content):
        length, kind = struct.unpack("<I4s", content[start : start + 8])
        found.setdefault(kind, content[start + 8 : start + 8 + length])
        start += 8 + length
    if JSON_CHUNK not in found:
        raise ValueError("it has no JSON chunk")
    return json.loads(decoded(found[JSON_CHUNK].rstrip(b"\0 "))), found.get(BINARY_CHUNK, b"")


def _check_extensions(tree: dict[str, Any]) -> None:
    # Where compression is not required, the file may hold the plain numbers as well.
    empty = [each for each in _positions(tree).values() if "bufferView" not in each and "sparse" not in each]
    for name in (*tree.get("extensionsRequired", ()), *(tree.get("extensionsUsed", ()) if empty else ())):
        if name in COMPRESSED:
            raise GltfError(
                f"its triangles are compressed by {COMPRESSED[name]} ({name}), which is not read; export it without "
                "compression, or as STL, OBJ or PLY"
            )
        is_required = name in tree.get("extensionsRequired", ())
        if is_required and name != QUANTISED and not any(word in name.lower() for word in HARMLESS):
            raise GltfError(f"needs {name[:60]}, which is not read; export it without, or as STL, OBJ or PLY")


def _check_buffers(tree: dict[str, Any], resolver: PercentResolver, path: Path) -> None:
    for each in tree.get("buffers", ()):
        address = each.get("uri", "data:")
        if not address.startswith("data:"):
            try:
                resolver.get(address)
            except (OSError, ValueError) as error:
                name = unquote(address)[:80]
                raise GltfError(
                    f"names a file {name!r} with its points, which is not in {path.parent}; put it beside this one, or "
                    "export to .glb, which holds all in one file"
                ) from error


def _positions(tree: dict[str, Any]) -> dict[int, dict[str, Any]]:
    """The accessors of positions by their index."""
    used = {
        primitive.get("attributes", {}).get("POSITION")
        for mesh in tree.get("meshes", ())
        for primitive in mesh.get("primitives", ())
    }
    return {index: each for index, each in enumerate(tree.get("accessors", ())) if index in used}


def _quantised(tree: dict[str, Any]) -> list[int]:
    """Accessors of positions that are whole numbers."""
    return [index for index, each in _positions(tree).items() if each["componentType"] in WHOLE_NUMBERS]


def _buffer(buffer: dict[str, Any], resolver: PercentResolver, binary: bytes) -> bytes:
    address = buffer.get("uri")
    if address is None:
        return binary
    if address.startswith("data:"):
        return base64.b64decode(address.partition(",")[2])
    return resolver.get(address)


def _write_out(tree: dict[str, Any], accessor: dict[str, Any], buffers: list[bytes]) -> bytes:
    """The positions of an accessor as floating-point numbers, and the accessor changed to name them."""
    if "sparse" in accessor or "bufferView" not in accessor:
        raise GltfError(
            "its quantised positions are sparse, which is not read; export it without quantisation"
        )
    values = _whole_numbers(accessor, tree["bufferViews"][accessor["bufferView"]], buffers).astype(np.float32)
    if accessor.get("normalized"):
        values = np.maximum(
            values / np.float32(WHOLE_NUMBERS[accessor["componentType"]][1]), np.float32(-1.0)
        )
    tree["bufferViews"].append({"buffer": len(buffers), "byteLength": values.nbytes})
    tree["buffers"].append({"byteLength": values.nbytes})
    accessor.update(
        bufferView=len(tree["bufferViews"]) - 1, byteOffset=0, componentType=FLOAT_TYPE, normalized=False
    )
    return values.tobytes()


def _whole_numbers(
    accessor: dict[str, Any], view: dict[str, Any], buffers: list[bytes]
) -> NDArray[np.integer[Any]]:
    """The numbers of an accessor as they are stored, shape (N, 3)."""
    dtype, n = np.dtype(WHOLE_NUMBERS[accessor["componentType"]][0]), int(accessor["count"])
    start = int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
    stride = int(view.get("byteStride", 3 * dtype.itemsize))
    data = buffers[view["buffer"]]
    if (
        n < 1
        or start < 0
        or stride < 3 * dtype.itemsize
        or start + (n - 1) * stride + 3 * dtype.itemsize > len(data)
    ):
        raise ValueError("its positions do not lie within their buffer")
    return np.ndarray((n, 3), dtype, data, start, (stride, dtype.itemsize))

"""The voxels of an NRRD file, read and unpacked to the size that the header names and not a byte more."""

from __future__ import annotations

import bz2
import zlib
from pathlib import Path
from typing import Any, BinaryIO

CHUNK_BYTES = 1 << 20


def read_payload(path: Path, header: dict[str, Any], start: int, n_bytes: int) -> bytearray:
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
    detached = header.get("data file", header.get("datafile"))
    if detached is not None:
        name = Path(str(detached))
        if name.is_absolute() or len(name.parts) != 1 or "%" in name.name or name.name == "LIST":
            raise ValueError(
                f"its voxels are in {str(detached)[:60]!r}; keep header and one data file together"
            )
        path, start = path.parent / name, 0
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

"""PNG files without row filters: the pictures of a renderer compress as well, in a quarter of the time.

Pillow tries five filters on every row, which takes longer than drawing. The format: PNG specification, 3rd edition.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_RGB, _BITS = 2, 8


def png_bytes(pixels: NDArray[np.uint8], *, compression: int = 1) -> bytes:
    """A picture as a PNG file.

    Args:
        pixels: Shape (height, width, 3).
        compression: Level of zlib's compression, 0 to 9.

    Raises:
        ValueError: The array is not an RGB picture.
    """
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8:
        raise ValueError(
            f"pixels must be uint8 of shape (height, width, 3), not {pixels.dtype} {pixels.shape}"
        )
    height_px, width_px = pixels.shape[:2]
    # Each row stands after the number of its filter, which is 0 for none.
    rows = np.zeros((height_px, 1 + 3 * width_px), dtype=np.uint8)
    rows[:, 1:] = pixels.reshape(height_px, -1)
    header = struct.pack(">IIBBBBB", width_px, height_px, _BITS, _RGB, 0, 0, 0)
    parts = (b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), compression)), (b"IEND", b"")
    return _SIGNATURE + b"".join(_chunk(kind, body) for kind, body in parts)


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

"""STL files: binary ones, whose count of triangles may be wrong, and text ones, of one solid or several."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.text import decoded

from .topology import is_closed

HEADER_BYTES = 84
"""Of a binary STL; the last four are the number of its triangles."""

TRIANGLE_BYTES = 50

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])

SOLID = re.compile(r"^[ \t]*solid\b[ \t]*(.*)$", re.IGNORECASE | re.MULTILINE)


class StlError(ValueError):
    """What is wrong with an STL file, and the remedy."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StlSolid:
    """A solid of an STL file.

    Attributes:
        name: What the file calls it; empty where it does not.
        corners: Corners of its triangles in the file's unit, shape (F, 3, 3).
    """

    name: str
    corners: NDArray[np.float64]


def read_stl(content: bytes) -> tuple[list[StlSolid], list[str]]:
    """The solids of an STL file, of which a binary one has one, and remarks.

    Args:
        content: All bytes of the file.

    Raises:
        StlError: The file is cut short, or no STL.
    """
    n_counted = int.from_bytes(content[HEADER_BYTES - 4 : HEADER_BYTES], "little")
    is_exact = len(content) >= HEADER_BYTES and len(content) == HEADER_BYTES + n_counted * TRIANGLE_BYTES
    if not is_exact and _is_text(content):
        return _read_text(content)
    corners, remarks = (_corners(content, n_counted), []) if is_exact else _miscounted(content, n_counted)
    return [StlSolid(name="", corners=corners)], remarks


def _is_text(content: bytes) -> bool:
    start = content[:512].removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    return start.startswith(b"solid") and b"\0" not in content[:4096]


def _corners(content: bytes, n: int) -> NDArray[np.float64]:
    """The corners of the first triangles of a binary file."""
    with np.errstate(invalid="ignore"):  # what is no STL holds signalling NaNs
        return np.frombuffer(content, RECORD, count=n, offset=HEADER_BYTES)["corners"].astype(np.float64)


def _miscounted(content: bytes, n_counted: int) -> tuple[NDArray[np.float64], list[str]]:
    """The corners of a binary file whose length does not fit its count, and remarks.

    Bytes after the last triangle that the header counts are left out, unless it counts none or what it counts is not
    closed and the rest closes it. A count above what follows is a file that was cut short, unless what follows is
    closed.

    Raises:
        StlError: The file is cut short.
    """
    n_there = max(len(content) - HEADER_BYTES, 0) // TRIANGLE_BYTES
    if n_there == 0 and n_counted == 0 and len(content) >= HEADER_BYTES:
        return np.empty((0, 3, 3)), []
    every = _corners(content, n_there) if n_there else np.empty((0, 3, 3))
    if 0 < n_counted < n_there and not (_is_closed(every) and not _is_closed(every[:n_counted])):
        n_left = len(content) - HEADER_BYTES - n_counted * TRIANGLE_BYTES
        return every[:n_counted], [f"{n_left:,} bytes after its last triangle were left out"]
    if n_counted == n_there:
        n_left = len(content) - HEADER_BYTES - n_counted * TRIANGLE_BYTES
        return every, [f"{n_left:,} bytes after its last triangle were left out"]
    if n_there and (n_counted == 0 or n_counted < n_there or _is_closed(every)):
        return every, [
            f"its header counts {n_counted:,} triangles, and the {n_there:,} that follow were read"
        ]
    raise StlError(
        f"is cut short or no STL: by its header {n_counted:,} triangles follow, and it ends after "
        f"{len(content):,} bytes; copy or export it again"
    )


def _is_closed(corners: NDArray[np.float64]) -> bool:
    if not len(corners) or not np.isfinite(corners).all():
        return False
    _, label = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return is_closed(label.reshape(-1, 3))


def _read_text(content: bytes) -> tuple[list[StlSolid], list[str]]:
    """The solids of a text file that have triangles, and remarks.

    Raises:
        StlError: The file ends within a triangle, or holds what is no triangle.
    """
    text = decoded(content).replace("\r\n", "\n").replace("\r", "\n")
    heads = list(SOLID.finditer(text))
    ends = [head.start() for head in heads[1:]] + [len(text)]
    solids = []
    for head, end in zip(heads, ends, strict=True):
        corners = _text_corners(text[head.end() : end].lower(), is_last=end == len(text))
        if len(corners):
            solids.append(StlSolid(name=_name_of(head[1]), corners=corners))
    is_ended = not heads or "endsolid" in text[heads[-1].end() :].lower()
    unended = "its last line, endsolid, is missing, and every triangle before it is whole"
    return solids, [] if is_ended or not solids else [unended]


def _text_corners(body: str, *, is_last: bool) -> NDArray[np.float64]:
    """The corners of the triangles of one solid, shape (F, 3, 3)."""
    begun, ended = len(re.findall(r"\bfacet\b", body)), len(re.findall(r"\bendfacet\b", body))
    if begun > ended and is_last:
        raise StlError(
            f"is cut short: the last of its {begun:,} triangles is not whole; copy or export it again"
        )
    # Only what stands on the line of a `vertex` is a number of it.
    lines = [line.partition("\n")[0] for line in body.split("vertex")[1:]]
    numbers = np.array(" ".join(lines).split(), dtype=np.float64)
    if len(numbers) != 9 * ended:
        raise StlError(
            f"holds {len(numbers):,} numbers for the corners of {ended:,} triangles, of which each takes nine; export "
            "a surface of triangles"
        )
    return numbers.reshape(-1, 3, 3)


def _name_of(words: str) -> str:
    """The name of a solid, without what exporters append to it, such as the axes or a comment."""
    return re.split(r"\s*(?:[;#]|\bSPACE\s*=|\bexported by\b|\bcreated by\b)", words, flags=re.IGNORECASE)[
        0
    ].strip()

"""Names of labels that the files themselves give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

MOST_SEGMENTS = 1000


def segment_names(header: Mapping[str, Any]) -> dict[int, str]:
    """The names that 3D Slicer gives the labels in a .seg.nrrd."""
    names = {}
    for index in range(MOST_SEGMENTS):
        name, value = header.get(f"Segment{index}_Name"), header.get(f"Segment{index}_LabelValue")
        if name is None:
            break
        if value is not None and str(value).isdecimal():
            names[int(value)] = unescaped(str(name))
    return names


def unescaped(value: str) -> str:
    """The value of an NRRD key, in which line breaks and backslashes are written with a backslash before them."""
    return value.replace("\\\\", "\0").replace("\\n", " ").replace("\0", "\\").strip()

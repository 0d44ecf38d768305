"""How much memory a file may take, which is checked before anything of it is read."""

from __future__ import annotations

import os
from pathlib import Path

MEMORY_SHARE = 0.4
"""Share of the machine's memory that one file may take."""

CONTAINER_LIMIT = Path("/sys/fs/cgroup/memory.max")
"""Where Linux says how much memory a container may take."""


def spare_bytes() -> float:
    """The bytes that one file may take: a share of the machine's memory, or of its container's if that is less."""
    return MEMORY_SHARE * _memory_bytes()


def _memory_bytes() -> int:
    try:
        n_bytes = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError, AttributeError):
        n_bytes = 8 * 2**30
    try:
        limit = CONTAINER_LIMIT.read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return n_bytes
    return min(n_bytes, int(limit)) if limit.isdecimal() else n_bytes

"""The journal of a campaign: one line per finished trial, with a checksum, safe on the disk before the next."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from sim.closeable import Closeable

from .study import key_of

Entry = dict[str, Any]
CHECKSUM_CHARACTERS = 8


class Journal(Closeable):
    """An append-only file of entries, each with the `settings` of its trial. One process writes it."""

    def __init__(self, path: Path) -> None:
        """Open a journal, which is made where there is none; part of a line that a kill left at its end is cut off."""
        self.path = path
        self.n_damaged = 0
        """Lines that were not whole; their trials are run again."""
        self._offsets: dict[str, int] = {}
        self._failed: set[str] = set()
        # A buffer would write again what a full disk refused.
        self._file = path.open("ab", buffering=0)
        self._end = 0
        for offset, line in _lines(path):
            entry = decoded(line)
            if entry is None:
                self.n_damaged += 1
            else:
                self._note(entry, offset)
            if line.endswith(b"\n"):
                self._end = offset + len(line)
        if self._end < path.stat().st_size:
            self._file.truncate(self._end)

    def __contains__(self, key: str) -> bool:
        """Whether the trial of that key is in the journal."""
        return key in self._offsets

    def __len__(self) -> int:
        """The number of trials."""
        return len(self._offsets)

    def keys(self) -> set[str]:
        """The keys of all trials."""
        return set(self._offsets)

    @property
    def n_failed(self) -> int:
        """The number of trials that failed, or whose worker died."""
        return len(self._failed)

    def is_failed(self, key: str) -> bool:
        """Whether the trial of that key failed, or its worker died."""
        return key in self._failed

    def append(self, entry: Entry) -> None:
        """Add an entry, and return when it is on the disk. A later entry of one trial replaces the earlier.

        Raises:
            OSError: The entry cannot be written, for example on a full disk; the journal is then as it was.
        """
        line = encoded(entry)
        try:
            rest = memoryview(line)
            while rest:
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except OSError:
            self._file.truncate(self._end)
            raise
        self._note(entry, self._end)
        self._end += len(line)

    def entries(self, keys: Iterable[str]) -> Iterator[Entry]:
        """The entries of trials, in the order of their keys; those that are not in the journal are left out."""
        with self.path.open("rb") as file:
            for key in keys:
                if key in self._offsets:
                    file.seek(self._offsets[key])
                    entry = decoded(file.readline())
                    assert entry is not None
                    yield entry

    def _note(self, entry: Entry, offset: int) -> None:
        key = key_of(entry["settings"])
        self._offsets[key] = offset
        if entry["row"]["status"] == "finished":
            self._failed.discard(key)
        else:
            self._failed.add(key)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_entries(path: Path) -> Iterator[Entry]:
    """The entries of a journal that may still be written, the last of each trial, in the order of writing."""
    latest: dict[str, Entry] = {}
    for _, line in _lines(path):
        entry = decoded(line)
        if entry is not None:
            latest[key_of(entry["settings"])] = entry
    yield from latest.values()


def encoded(entry: Entry) -> bytes:
    """The line of an entry: checksum, blank, JSON."""
    text = json.dumps(entry, separators=(",", ":"), allow_nan=False).encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def decoded(line: bytes) -> Entry | None:
    """The entry of a line; None where the line is not whole."""
    start, text = line[: CHECKSUM_CHARACTERS + 1], line[CHECKSUM_CHARACTERS + 1 : -1]
    if not line.endswith(b"\n") or start != b"%08x " % zlib.crc32(text):
        return None
    return json.loads(text)


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """The lines of a file, each after the place where it begins."""
    offset = 0
    with path.open("rb") as file:
        for line in file:
            yield offset, line
            offset += len(line)

"""Locked folders, which one process owns while it holds them open."""

from __future__ import annotations

from pathlib import Path

from sim.closeable import Closeable
from sim.errors import UsageError

from .file_lock import lock_file
from .ownership import LOCK, MANIFEST, check_out_folder


class LockedFolder(Closeable):
    """A folder that is locked while it is open; the system frees the lock of a process that is killed."""

    def __init__(self, path: Path, *, what: str, overwrite: bool, marker: str = MANIFEST) -> None:
        """Make and lock a folder.

        Args:
            path: The folder.
            what: What may be writing there already, for the error's text: a `run`, a `campaign`.
            overwrite: Whether a folder that holds a run may be taken.
            marker: The JSON file by which the program knows a folder of its own.

        Raises:
            UsageError: The folder holds a run or files that are not ours, belongs to a running process, or cannot be
                written.
        """
        check_out_folder(path, overwrite=overwrite, marker=marker)
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = (path / LOCK).open("w")
        except OSError as error:
            raise UsageError(
                f"{path}: cannot write there ({error.strerror}). Choose another `out`."
            ) from error
        try:
            lock_file(self._lock)
        except OSError as error:
            self._lock.close()
            raise UsageError(f"{path}: another {what} is writing there. Choose another `out`.") from error

    def close(self) -> None:
        """Unlock the folder."""
        self._lock.close()

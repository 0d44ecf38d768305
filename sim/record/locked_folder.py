"""Locked folders, which one process owns while it holds them open."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from sim.closeable import Closeable
from sim.errors import UsageError

MANIFEST = "manifest.json"
"""The file by which a folder is known for that of a run."""
LOCK = ".lock"


def check_out_folder(path: Path, *, overwrite: bool) -> None:
    """Check that a run may be written to a folder; done early, so that no work is lost on a bad folder.

    Raises:
        UsageError: The path is a file, is not writable, or holds a run and `overwrite` is not set.
    """
    if path.exists() and not path.is_dir():
        raise UsageError(f"{path}: is a file, not a folder. Choose another `out`.")
    existing = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    if not os.access(existing, os.W_OK | os.X_OK):
        raise UsageError(f"{path}: cannot write there (no permission in {existing}). Choose another `out`.")
    if (path / MANIFEST).exists() and not overwrite:
        raise UsageError(
            f"{path}: already holds a run. Choose another `out`, or add `overwrite` to replace it."
        )


def check_run_folder(path: Path) -> None:
    """Check that a folder is that of a run.

    Raises:
        UsageError: It holds no run.
    """
    if not (path / MANIFEST).is_file():
        raise UsageError(f"{path}: holds no run. Name the folder that `sounding episode` wrote.")


class LockedFolder(Closeable):
    """A folder that is locked while it is open; the system frees the lock of a process that is killed."""

    def __init__(self, path: Path, *, what: str, overwrite: bool) -> None:
        """Make and lock a folder.

        Args:
            path: The folder.
            what: What may be writing there already, for the error's text: a `run`, a `campaign`.
            overwrite: Whether a folder that holds a run may be taken.

        Raises:
            UsageError: The folder holds a run, belongs to a running process, or cannot be written.
        """
        check_out_folder(path, overwrite=overwrite)
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = (path / LOCK).open("w")
        except OSError as error:
            raise UsageError(
                f"{path}: cannot write there ({error.strerror}). Choose another `out`."
            ) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._lock.close()
            raise UsageError(f"{path}: another {what} is writing there. Choose another `out`.") from error

    def close(self) -> None:
        """Unlock the folder."""
        self._lock.close()

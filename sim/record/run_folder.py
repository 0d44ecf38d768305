"""The run folder: everything a run writes, as it goes, so that an end at any moment leaves a valid folder."""

from __future__ import annotations

import io
import json
import platform
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_info

from mapping.storage import replacing
from sim.tables import CsvTable

from .locked_folder import LockedFolder
from .ownership import LOCK, MANIFEST, files_of_run, names_in

PACKAGES = ("mujoco", "mink", "numpy", "scipy", "trimesh", "daqp", "toppra")
BODY_JSON = "body.json"
"""Where the organ is believed to lie, and where it lies, where it does not lie as planned."""
OWN_MAP, OWN_TARGET_MAP = "own_map.npz", "own_target_map.npz"
"""What a map of a user's own, and that of a second class, wrote by its method `save`."""


class RunFolder(LockedFolder):
    """A folder that one run owns while it is open, as a context manager."""

    def __init__(self, path: Path, *, overwrite: bool = False) -> None:
        """Claim a folder for a run; the files of an earlier run in it are removed when `overwrite` is set.

        Raises:
            UsageError: The folder holds a run already or files that are not ours, belongs to a running process, or
                cannot be written.
        """
        super().__init__(path, what="run", overwrite=overwrite)
        self._tables: dict[str, tuple[io.TextIOWrapper, CsvTable]] = {}
        self._manifest: dict[str, Any] = {}
        for file in files_of_run(path):
            file.unlink(missing_ok=True)

    def begin(self, config: Mapping[str, Any], manifest: Mapping[str, Any]) -> None:
        """Write what is known before the first step; from here on the folder is a valid, unfinished run."""
        self._manifest = {**describe_machine(), **manifest, "status": "unfinished", "started": now()}
        self.write_json(MANIFEST, self._manifest)  # first: by it the folder is known for ours
        self.write_json("config.json", config)

    def finish(self, status: str) -> None:
        """Mark the run `finished` or `interrupted`."""
        self._manifest.update(status=status, ended=now())
        self.write_json(MANIFEST, self._manifest)

    def append_row(self, name: str, row: Mapping[str, Any]) -> None:
        """Append a row to a CSV file; it outlives the process at once. The first row fixes the columns."""
        if name not in self._tables:
            file = (self.path / name).open("w", newline="", encoding="utf-8")
            self._tables[name] = (file, CsvTable(file, list(row)))
        file, table = self._tables[name]
        table.append(row)
        file.flush()

    def write_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Replace a JSON file at once: a reader sees the old or the new one, never half of it."""
        text = json.dumps(content, indent=2, default=_plain, allow_nan=False) + "\n"
        self._replace(name, text.encode())

    def write_text(self, name: str, text: str) -> None:
        """Replace a text file at once."""
        self._replace(name, text.encode(errors="surrogateescape"))

    def write_bytes(self, name: str, content: bytes) -> None:
        """Replace a file at once."""
        self._replace(name, content)

    def write_arrays(self, name: str, *, compressed: bool, **arrays: NDArray[Any]) -> None:
        """Replace an npz file at once."""
        buffer = io.BytesIO()
        save: Callable[..., None] = np.savez_compressed if compressed else np.savez
        save(buffer, **arrays)
        self._replace(name, buffer.getvalue())

    def _replace(self, name: str, content: bytes) -> None:
        target = self.path / name
        target.parent.mkdir(exist_ok=True)
        with replacing(target) as file:
            file.write(content)

    def close(self) -> None:
        """Close the tables, list the run's files in its manifest, and unlock the folder.

        Whoever replaces the run removes the files that are listed, and no others.
        """
        for file, _ in self._tables.values():
            file.close()
        if self._manifest:
            with suppress(OSError):  # on a full disk the files are known by their names
                self.write_json(MANIFEST, self._manifest | {"files": [*names_in(self.path)]})
        super().close()
        (self.path / LOCK).unlink(missing_ok=True)


def describe_machine() -> dict[str, Any]:
    """The versions, commit, platform and BLAS threads, which whoever repeats a run needs to know."""
    return {
        "sounding": _version("sounding"),
        "commit": _commit(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: _version(name) for name in PACKAGES},
        "blas_threads": sorted({int(pool["num_threads"]) for pool in threadpool_info()}),
        "command": sys.argv[1:],
    }


def _version(package: str) -> str | None:
    """The version of a package; None where it is not installed: toppra on some systems, Sounding in a bare clone."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _commit() -> str | None:
    """The commit of the checkout that the code runs from, with `+` when it has changes; None in a wheel."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None
    try:
        call = ["git", "-C", str(root), "describe", "--always", "--abbrev=40", "--dirty=+", "--exclude=*"]
        return subprocess.run(call, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None


def now() -> str:
    """The present time in UTC, to the second, as ISO 8601 writes it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def _plain(value: Any) -> Any:
    """The JSON form of a value that json does not know."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")

"""The run folder: everything a run writes, as it goes, so that an end at any moment leaves a valid folder."""

from __future__ import annotations

import io
import json
import platform
import subprocess
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_info

from mapping.storage import replacing
from sim.tables import CsvTable

from .locked_folder import LOCK, MANIFEST, LockedFolder

PACKAGES = ("mujoco", "mink", "numpy", "scipy", "trimesh", "daqp", "toppra")
WRITTEN = (
    "config.json",
    "steps.csv",
    "skipped.csv",
    "states.csv",
    "summary.json",
    "map.npz",
    "map_probability.nii.gz",
    "map_standard_deviation.nii.gz",
    "map_labels.nii.gz",
    "map_target_probability.nii.gz",
    "map_target_standard_deviation.nii.gz",
    "map_target_labels.nii.gz",
    "structures.csv",
    "anatomy.npz",
    "reach.csv",
    "reach.parquet",
    "bases.csv",
    "arms.csv",
    "arms.md",
    "poses.csv",
    "poses.json",
    "tumours.csv",
    "false_findings.csv",
    "targets.csv",
    "target_false_findings.csv",
    "findings.json",
    "report.html",
)
"""Files of a run besides the manifest, figures and frames."""


class RunFolder(LockedFolder):
    """A folder that one run owns while it is open, as a context manager."""

    def __init__(self, path: Path, *, overwrite: bool = False) -> None:
        """Claim a folder for a run; an earlier run in it is removed when `overwrite` is set.

        Raises:
            UsageError: The folder holds a run already, belongs to a running process, or cannot be written.
        """
        super().__init__(path, what="run", overwrite=overwrite)
        self._tables: dict[str, tuple[io.TextIOWrapper, CsvTable]] = {}
        self._manifest: dict[str, Any] = {}
        self._remove_old_run()

    def begin(self, config: Mapping[str, Any], manifest: Mapping[str, Any]) -> None:
        """Write what is known before the first step; from here on the folder is a valid, unfinished run."""
        self.write_json("config.json", config)
        self._manifest = {**describe_machine(), **manifest, "status": "unfinished", "started": _now()}
        self.write_json(MANIFEST, self._manifest)

    def finish(self, status: str) -> None:
        """Mark the run `finished` or `interrupted`."""
        self._manifest.update(status=status, ended=_now())
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
        self._replace(name, text.encode())

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

    def _remove_old_run(self) -> None:
        frames = self.path / "frames"
        old = [
            *(self.path / name for name in (*WRITTEN, MANIFEST)),
            *self.path.glob("*.png"),
            *frames.glob("*.png"),
            *(self.path / "motion").glob("*.npz"),
            *(self.path / "maps").glob("*.npz"),
            *(self.path / "surfaces").glob("mapped*"),
        ]
        for file in old:
            file.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the tables and unlock the folder."""
        for file, _ in self._tables.values():
            file.close()
        super().close()
        (self.path / LOCK).unlink(missing_ok=True)


def describe_machine() -> dict[str, Any]:
    """The versions, commit, platform and BLAS threads, which whoever repeats a run needs to know."""
    return {
        "sounding": metadata.version("sounding"),
        "commit": _commit(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: metadata.version(name) for name in PACKAGES},
        "blas_threads": sorted({int(pool["num_threads"]) for pool in threadpool_info()}),
        "command": sys.argv[1:],
    }


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


def _now() -> str:
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

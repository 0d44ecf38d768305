"""Whose files a folder holds: a program writes only where nothing of somebody else's lies, and removes only its own."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sim.errors import UsageError

MANIFEST = "manifest.json"
"""The file by which a folder is known for that of a run."""
LOCK = ".lock"
RUN_NAMES = re.compile(
    r"""config\.json | summary\.json | findings\.json | body\.json | report\.html
    | (steps|readings|skipped|states|structures|poses|tumours|false_findings|targets|target_false_findings)\.csv
    | poses\.json | probe\.xml | anatomy\.npz | map\.npz | visible\.npz | own_(target_)?map\.npz
    | map_(target_)?(on_scan_)?(probability|standard_deviation|labels)\.nii\.gz
    | map(_target)?\.seg\.nrrd | map_(target_)?(segmentation|probability)\.dcm
    | (auprc|precision_recall|map_top|map_side|map_target_top|map_target_side)\.png
    | ultrasound/\d+(-\d+)?\.png
    | (frames/\d+|frames/final)\.png | (motion|maps)/\d+\.npz | surfaces/mapped[^/]*
    | reach\.(csv|parquet|png) | reasons\.png | bases\.(csv|png) | arms\.(csv|md|png)""",
    re.VERBOSE,
)
"""Files that runs write, for runs whose manifest lists none: those that were killed, and those of older versions."""


def check_out_folder(path: Path, *, overwrite: bool, marker: str = MANIFEST) -> None:
    """Check that a program may write to a folder; done early, so that no work is lost on a bad folder.

    Args:
        path: The folder, which need not be there.
        overwrite: Whether a run that the folder holds may be replaced.
        marker: The JSON file by which the program knows a folder of its own.

    Raises:
        UsageError: The path is a file or not writable, the folder holds a run and `overwrite` is not set, or it holds
            files that no program of ours wrote.
    """
    if path.exists() and not path.is_dir():
        raise UsageError(f"{path}: is a file, not a folder. Choose another `out`.")
    existing = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    if not os.access(existing, os.W_OK | os.X_OK):
        raise UsageError(f"{path}: cannot write there (no permission in {existing}). Choose another `out`.")
    if is_ours(path / MANIFEST) and not overwrite:
        raise UsageError(
            f"{path}: already holds a run. Choose another `out`, or add `overwrite` to replace it."
        )
    if not is_ours(path / MANIFEST) and not is_ours(path / marker):
        refuse_strangers(path)


def check_run_folder(path: Path) -> None:
    """Check that a folder is that of a run.

    Raises:
        UsageError: It holds no run.
    """
    if not (path / MANIFEST).is_file():
        raise UsageError(f"{path}: holds no run. Name the folder that `sounding episode` wrote.")


def refuse_strangers(path: Path) -> None:
    """Check that a folder, which is not known to be ours, holds nothing.

    Raises:
        UsageError: It does.
    """
    entries = sorted(entry.name for entry in path.iterdir()) if path.is_dir() else []
    if strangers := [name for name in entries if name != LOCK]:
        raise UsageError(
            f"{path}: is not empty (it holds {strangers[0]}, for example), and this command wrote none of it. "
            "Choose another `out`, which need not be there yet."
        )


def is_ours(marker: Path) -> bool:
    """Whether a file is a marker that a program of ours wrote: JSON that says which version did."""
    content = _json(marker)
    return "sounding" in content or "sounding" in content.get("machine", {})


def files_of_run(folder: Path) -> list[Path]:
    """The files of the run that a folder holds, the manifest among them; none where it holds no run.

    They are those that the manifest lists. A run that was killed lists none: its files are then known by their names.
    """
    if not is_ours(folder / MANIFEST):
        return []
    listed = _json(folder / MANIFEST).get("files")
    names = (
        listed
        if isinstance(listed, list)
        else [name for name in names_in(folder) if RUN_NAMES.fullmatch(name)]
    )
    inside = [
        folder / name for name in names if ".." not in Path(name).parts and not Path(name).is_absolute()
    ]
    return [file for file in (*inside, folder / MANIFEST) if file.is_file() or file.is_symlink()]


def names_in(folder: Path) -> Iterator[str]:
    """The names of all files in a folder, those in folders of it too unless these hold runs of their own."""
    for entry in sorted(folder.iterdir()):
        if entry.is_dir() and not entry.is_symlink():
            if not is_ours(entry / MANIFEST):
                yield from (f"{entry.name}/{name}" for name in names_in(entry))
        elif entry.name not in (LOCK, MANIFEST):
            yield entry.name


def _json(file: Path) -> dict[str, Any]:
    """The content of a JSON file, empty where there is none that can be read."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}

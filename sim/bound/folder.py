"""The folder of a bound: its certificate, as JSON and CSV for people and as arrays for the check."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.storage import replacing
from sim.errors import UsageError
from sim.record.default_folders import is_free
from sim.record.locked_folder import LockedFolder
from sim.tables import write_csv

from .cover import CoverBound
from .hindsight import SeedBound
from .poses import StandingPoses

FORMAT = 1
BOUND, SEEDS, POSES = "bound.json", "seeds.csv", "poses.npz"
SEED_FOLDER = "seeds"
QUESTION = ("options", "goal", "n_places", "first_place")
"""Parts of bound.json that say what was asked, besides the seeds."""


class BoundFolder(LockedFolder):
    """A folder that one call owns while it is open. What it holds of the same question is kept."""

    def __init__(self, path: Path, *, overwrite: bool = False) -> None:
        """Claim a folder; an earlier bound in it is removed when `overwrite` is set.

        Raises:
            UsageError: The folder holds something else, belongs to a running call, or cannot be written.
        """
        super().__init__(path, what="bound", overwrite=False, marker=BOUND)
        if overwrite:
            for file in (*path.glob("*/*.npz"), *path.glob("*.npz"), path / SEEDS, path / BOUND):
                file.unlink(missing_ok=True)

    def begin(self, question: Mapping[str, Any]) -> None:
        """Write what is asked.

        Raises:
            UsageError: The folder holds the answer to another question.
        """
        before = None if not (self.path / BOUND).is_file() else read_bound(self.path)
        if before is not None and any(before.get(name) != question[name] for name in QUESTION):
            raise UsageError(
                f"{self.path}: holds another bound. Choose another `out`, or add `overwrite` to replace it."
            )
        (self.path / SEED_FOLDER).mkdir(exist_ok=True)
        self.write(question)

    def write(self, content: Mapping[str, Any]) -> None:
        """Write bound.json."""
        text = json.dumps({"format": FORMAT, **content}, indent=2, allow_nan=False)
        with replacing(self.path / BOUND) as file:
            file.write((text + "\n").encode())

    def has_seed(self, seed: int) -> bool:
        """Whether the bound of a seed is there."""
        return _seed_file(self.path, seed).is_file()

    def write_seed(self, bound: SeedBound) -> None:
        """Write the bound of a seed."""
        cover = bound.cover
        arrays: dict[str, Any] = {
            "seed": bound.seed,
            "n_tumours": bound.n_tumours,
            "n_points": bound.n_points,
            "need": bound.need,
            "is_possible": cover is not None,
        }
        if cover is not None:
            arrays |= {
                "least": cover.least,
                "solver_least": cover.solver_least,
                "value": cover.value,
                "worth": cover.worth,
                "prices": cover.prices,
                "chosen": np.array(cover.chosen, dtype=np.int64),
            }
        write_arrays(_seed_file(self.path, bound.seed), arrays)

    def write_table(self, bounds: list[SeedBound]) -> None:
        """Write seeds.csv, a row for each seed."""
        write_csv(self.path / SEEDS, map(seed_row, bounds), SEED_COLUMNS)

    def write_poses(self, poses: StandingPoses) -> None:
        """Write the poses that are reached."""
        write_arrays(self.path / POSES, {"pose": poses.pose, "apex_m": poses.apex_m, "axis": poses.axis})


SEED_COLUMNS = ("seed", "n_tumours", "n_points", "need", "least", "solver_least", "most", "value", "poses")


def seed_row(bound: SeedBound) -> dict[str, Any]:
    """The bound of a seed as a row of seeds.csv; what no poses can do has no numbers."""
    cover = bound.cover
    row: dict[str, Any] = {
        "seed": bound.seed,
        "n_tumours": bound.n_tumours,
        "n_points": bound.n_points,
        "need": bound.need,
    }
    if cover is None:
        return row
    return row | {
        "least": cover.least,
        "solver_least": cover.solver_least,
        "most": cover.most,
        "value": cover.value,
        "poses": list(cover.chosen),
    }


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays as an npz file, whole or not at all."""
    with replacing(path) as file:
        np.savez_compressed(
            file, allow_pickle=False, **{name: np.asarray(each) for name, each in arrays.items()}
        )


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an npz file.

    Raises:
        UsageError: The file is missing or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
        raise UsageError(f"{path}: cannot be read ({error}).") from error


def read_bound(path: Path) -> dict[str, Any]:
    """What bound.json of a folder says.

    Raises:
        UsageError: There is no such file, or it cannot be used.
    """
    file = path / BOUND
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise UsageError(f"{path}: holds no bound. Name a folder that `sounding bound` wrote.") from error
    except (OSError, ValueError) as error:
        raise UsageError(f"{file}: cannot be read ({error}).") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UsageError(f"{file}: is not the bound of a version that this one reads (format {FORMAT}).")
    return content


def read_seed(path: Path, seed: int) -> SeedBound:
    """The bound of a seed.

    Raises:
        UsageError: The seed's file is missing, damaged, or lacks something.
    """
    file = _seed_file(path, seed)
    arrays = read_arrays(file)
    try:
        cover = None
        if bool(arrays["is_possible"]):
            cover = CoverBound(
                least=int(arrays["least"]),
                solver_least=int(arrays["solver_least"]),
                chosen=tuple(int(each) for each in arrays["chosen"]),
                value=float(arrays["value"]),
                prices=np.asarray(arrays["prices"], dtype=np.float64),
                worth=float(arrays["worth"]),
            )
        numbers = {name: int(arrays[name]) for name in ("seed", "n_tumours", "n_points", "need")}
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{file}: is no whole bound of a seed ({error}).") from error
    return SeedBound(**numbers, cover=cover)


def can_hold(path: Path, question: Mapping[str, Any]) -> bool:
    """Whether a folder is free, or holds the bound of the same question."""
    if is_free(path):
        return True
    try:
        before = read_bound(path)
    except UsageError:
        return False
    return all(before.get(name) == question[name] for name in QUESTION)


def _seed_file(path: Path, seed: int) -> Path:
    return path / SEED_FOLDER / f"{seed:06d}.npz"

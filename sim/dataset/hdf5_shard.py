"""A shard as an HDF5 file: a group an episode, whose datasets hold a row an action."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from sim.world.optional import optional_module

from .record import STEP_FIELDS, EpisodeRecord

RAGGED = ("points_m", "is_occupied", "is_tumour", "belief", "image", "image_mask", "T_world_image")
"""Fields whose rows differ in length: they stand one after the other, and `<name>_length` tells their lengths."""

PICTURES = ("image", "image_mask")
"""Fields whose rows are files."""


def h5py() -> ModuleType:
    """The module h5py.

    Raises:
        MissingPackageError: It is not installed.
    """
    return optional_module("h5py", "hdf5", "a dataset in HDF5")


def file_of(folder: Path, shard: int) -> Path:
    """The file of a shard."""
    return folder / f"shard-{shard:05d}.h5"


def n_episodes(folder: Path, shard: int) -> int:
    """How many episodes a shard holds; 0 where it was not written whole, or is damaged."""
    file = file_of(folder, shard)
    if not file.is_file():
        return 0
    try:
        with h5py().File(file) as content:
            return len(content)
    except OSError:
        return 0


def last_files(folder: Path) -> Iterable[Path]:
    """The file of each shard in a folder that is written last, whole or not."""
    return folder.glob("shard-*.h5")


class Hdf5Shard:
    """A shard that is written episode by episode."""

    def __init__(self, folder: Path, shard: int) -> None:
        """Begin the file of a shard under a name that is not yet its own."""
        self._file = file_of(folder, shard)
        self._file.parent.mkdir(parents=True, exist_ok=True)
        self._partial = self._file.with_name(f".{self._file.name}.part")
        self._open = h5py().File(self._partial, "w")

    def add(self, episode_index: int, record: EpisodeRecord) -> None:
        """Write an episode."""
        group = self._open.create_group(f"episode_{episode_index:06d}")
        for name, value in record.episode.items():
            if isinstance(value, np.ndarray):
                group.create_dataset(name, data=value, compression="gzip" if value.size > 100 else None)
            else:
                group.attrs[name] = value
        steps = group.create_group("steps")
        for name in STEP_FIELDS:
            self._column(steps, name, [row[name] for row in record.steps])

    def close(self) -> None:
        """End the shard; only now its file has its name."""
        self._open.close()
        self._partial.replace(self._file)

    def _column(self, steps: Any, name: str, values: list[Any]) -> None:
        if name not in RAGGED:
            steps.create_dataset(name, data=np.array(values))
            return
        arrays = [
            np.frombuffer(each or b"", dtype=np.uint8) if name in PICTURES else np.asarray(each)
            for each in values
        ]
        flat = np.concatenate(arrays) if arrays else np.empty(0)
        steps.create_dataset(name, data=flat, compression="gzip" if flat.size else None)
        steps.create_dataset(f"{name}_length", data=np.array([len(each) for each in arrays], dtype=np.int64))

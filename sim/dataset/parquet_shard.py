"""A shard as two Parquet files: a row an action, a row group an episode; and a row an episode."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from sim.world.optional import optional_module

from .record import EpisodeRecord

_LISTS = {
    "observation.tip": "float",
    "action": "float",
    "points_m": "float",
    "T_world_probe": "double",
    "joints": "double",
    "T_world_image": "double",
    "is_occupied": "bool_",
    "is_tumour": "bool_",
}
_NUMBERS = {
    "episode_index": "int64",
    "seed": "int64",
    "frame_index": "int64",
    "timestamp": "float64",
    "observation.sensed": "float64",
    "observation.auprc": "float64",
    "pose_index": "int64",
    "motion_s": "float64",
    "contact_force_n": "float64",
    "next.sensed": "float64",
    "next.auprc": "float64",
    "next.done": "bool_",
}


def pyarrow() -> ModuleType:
    """The module pyarrow, with its writer of Parquet.

    Raises:
        MissingPackageError: It is not installed.
    """
    optional_module("pyarrow.parquet", "parquet", "a dataset in Parquet")
    return optional_module("pyarrow", "parquet", "a dataset in Parquet")


def files_of(folder: Path, shard: int) -> tuple[Path, Path]:
    """The files of a shard: actions and episodes. The second is written last."""
    return (
        folder / "steps" / f"shard-{shard:05d}.parquet",
        folder / "episodes" / f"shard-{shard:05d}.parquet",
    )


def n_episodes(folder: Path, shard: int) -> int:
    """How many episodes a shard holds; 0 where it was not written whole, or is damaged."""
    pa, files = pyarrow(), files_of(folder, shard)
    if not all(file.is_file() for file in files):
        return 0
    try:
        # Actions are told by their row groups, one an episode.
        return min(
            pa.parquet.read_metadata(files[0]).num_row_groups, pa.parquet.read_metadata(files[1]).num_rows
        )
    except (OSError, pa.ArrowInvalid):
        return 0


def last_files(folder: Path) -> Iterable[Path]:
    """The file of each shard in a folder that is written last, whole or not."""
    return (folder / "episodes").glob("shard-*.parquet")


class ParquetShard:
    """A shard that is written episode by episode."""

    def __init__(self, folder: Path, shard: int) -> None:
        """Begin the files of a shard under names that are not yet theirs."""
        self._pa = pyarrow()
        self._files = files_of(folder, shard)
        for file in self._files:
            file.parent.mkdir(parents=True, exist_ok=True)
        self._partial = self._files[0].with_name(f".{self._files[0].name}.part")
        self._writer = self._pa.parquet.ParquetWriter(self._partial, self._schema(), compression="zstd")
        self._episodes: list[dict[str, Any]] = []

    def add(self, episode_index: int, record: EpisodeRecord) -> None:
        """Write an episode."""
        seed = record.episode["seed"]
        rows = [
            {"episode_index": episode_index, "seed": seed}
            | {name: _plain(name, value) for name, value in row.items()}
            for row in record.steps
        ]
        self._writer.write_table(self._pa.Table.from_pylist(rows, schema=self._schema()))
        plain = {name: _plain(name, value) for name, value in record.episode.items()}
        for name in ("is_inside", "is_tumour"):
            plain[name] = record.episode[name].tobytes()
        self._episodes.append({"episode_index": episode_index} | plain)

    def close(self) -> None:
        """End the shard; only now its files have their names."""
        self._writer.close()
        episodes = self._files[1].with_name(f".{self._files[1].name}.part")
        table = self._pa.Table.from_pylist(self._episodes)
        self._pa.parquet.write_table(table, episodes, compression="zstd")
        self._partial.replace(self._files[0])
        episodes.replace(self._files[1])

    def _schema(self) -> Any:
        pa = self._pa
        fields = [(name, getattr(pa, kind)()) for name, kind in _NUMBERS.items()]
        kinds = {"float": pa.float32(), "double": pa.float64(), "bool_": pa.bool_()}
        fields += [(name, pa.list_(kinds[kind])) for name, kind in _LISTS.items()]
        return pa.schema([*fields, *((name, pa.binary()) for name in ("belief", "image", "image_mask"))])


def _plain(name: str, value: Any) -> Any:
    """A value as Arrow takes it."""
    if isinstance(value, np.ndarray):
        return value.tobytes() if name == "belief" else value.tolist()
    return value.item() if isinstance(value, np.generic) else value

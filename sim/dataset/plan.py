"""The plan of a dataset: which episodes, in which files, and which of them are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from sim.running.config import EpisodeConfig
from sim.running.config_file import inputs_of
from sim.running.fields import recorded

from . import hdf5_shard, parquet_shard

Format = Literal["parquet", "hdf5", "lerobot"]


@dataclass(frozen=True, kw_only=True)
class DatasetPlan:
    """What is to be built."""

    config: EpisodeConfig
    """The episodes, but for their seeds."""
    seeds: Sequence[int]
    format: Format
    shard_size: int
    """Episodes of a shard."""
    folder: Path

    @property
    def n_shards(self) -> int:
        """The number of shards."""
        return -(-len(self.seeds) // self.shard_size)

    def members(self, shard: int) -> range:
        """The numbers of the episodes of a shard."""
        first = min(shard * self.shard_size, len(self.seeds))
        return range(first, min(first + self.shard_size, len(self.seeds)))

    def is_there(self, shard: int) -> bool:
        """Whether a shard was written whole, and is not one of fewer episodes that was the last before."""
        return self._kind.n_episodes(self.shards_folder, shard) == len(self.members(shard))

    def n_beyond(self) -> int:
        """How many episodes the folder holds that the plan does not have."""
        folder, n_more = self.shards_folder, 0
        names = [file.stem.removeprefix("shard-") for file in self._kind.last_files(folder)]
        for shard in (int(name) for name in names if name.isdecimal()):
            n, n_planned = self._kind.n_episodes(folder, shard), len(self.members(shard))
            # A damaged shard that the plan has not would stay as it is.
            n_more += max(n - n_planned, 0) if n_planned else max(n, 1)
        return n_more

    @property
    def _kind(self) -> ModuleType:
        return hdf5_shard if self.format == "hdf5" else parquet_shard

    @property
    def shards_folder(self) -> Path:
        """Where the shards lie; LeRobot's files are made of them."""
        return self.folder / "shards" if self.format == "lerobot" else self.folder

    def identity(self) -> dict[str, Any]:
        """What the folder goes on with, as plain data; more seeds may follow later."""
        values = {name: value for name, value in recorded(self.config).items() if name != "seed"}
        return {
            "first_seed": self.seeds[0],
            "format": self.format,
            "shard_size": self.shard_size,
            "episodes": values,
            "inputs": inputs_of(self.config),
        }

"""A dataset as LeRobot reads it: LeRobotDataset of version 3.0, made of the shards, one data file a shard.

The layout is that of LeRobot 0.4 (lerobot/datasets/utils.py, Apache-2.0): `data/` has the frames, `meta/` their kinds.
Of a frame it holds the fields of one length; all fields stay in the shards.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.storage import replacing

from .parquet_shard import files_of, pyarrow

VERSION, FILES_A_CHUNK = "v3.0", 1000
FPS = 1
"""LeRobot's frames are even in time, and actions are not: frame n stands at n s; `observation.time` is its time."""
TASK = "find the hidden tumours"
_AXES = ("x_m", "y_m", "z_m", "beam_x", "beam_y", "beam_z")
FEATURES: dict[str, dict[str, Any]] = {
    "observation.state": {"dtype": "float32", "shape": [6], "names": list(_AXES)},
    "action": {"dtype": "float32", "shape": [6], "names": list(_AXES)},
    "observation.time": {"dtype": "float32", "shape": [1], "names": None},
    "next.reward": {"dtype": "float32", "shape": [1], "names": None},
    "next.done": {"dtype": "bool", "shape": [1], "names": None},
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    "frame_index": {"dtype": "int64", "shape": [1], "names": None},
    "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    "index": {"dtype": "int64", "shape": [1], "names": None},
    "task_index": {"dtype": "int64", "shape": [1], "names": None},
}
"""The fields of a frame. `next.reward` is the share of the tumours that the action sensed for the first time."""


class _Moments:
    """Least, largest, mean and spread of values that come in parts."""

    def __init__(self) -> None:
        self.n, self.total, self.squares = 0, np.zeros(1), np.zeros(1)
        self.least, self.most = np.array([np.inf]), np.array([-np.inf])

    def add(self, values: NDArray[Any]) -> None:
        """Take in values, a row each."""
        rows = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
        self.n += len(rows)
        self.total, self.squares = self.total + rows.sum(axis=0), self.squares + (rows**2).sum(axis=0)
        self.least, self.most = (
            np.minimum(self.least, rows.min(axis=0)),
            np.maximum(self.most, rows.max(axis=0)),
        )

    def told(self) -> dict[str, list[Any]]:
        """The statistics as LeRobot names them."""
        mean = self.total / self.n
        spread = np.sqrt(np.maximum(self.squares / self.n - mean**2, 0.0))
        values = {"min": self.least, "max": self.most, "mean": mean, "std": spread}
        return {name: each.tolist() for name, each in values.items()} | {"count": [self.n]}


def write_lerobot(folder: Path, shards: Path, n_shards: int, scenario: str) -> None:
    """Write `data/` and `meta/` of a dataset whose shards are all there.

    Args:
        folder: The dataset's folder.
        shards: The folder of its shards.
        n_shards: How many there are.
        scenario: What the episodes are of.
    """
    pq, moments = pyarrow().parquet, {name: _Moments() for name in FEATURES}
    episodes: list[dict[str, Any]] = []
    n_frames = 0
    for shard in range(n_shards):
        columns = ["episode_index", "frame_index", "timestamp", "observation.tip", "action"]
        columns += ["observation.sensed", "next.sensed", "next.done"]
        table = pq.read_table(files_of(shards, shard)[0], columns=columns)
        frames = _frames(table.to_pydict(), n_frames)
        chunk, file = divmod(shard, FILES_A_CHUNK)
        _write_table(folder / f"data/chunk-{chunk:03d}/file-{file:03d}.parquet", frames)
        for name, each in moments.items():
            if table.num_rows:
                each.add(np.array(frames[name]))
        numbers, firsts, lengths = np.unique(frames["episode_index"], return_index=True, return_counts=True)
        episodes += [
            _episode(int(number), n_frames + int(first), int(length), chunk, file)
            for number, first, length in zip(numbers, firsts, lengths, strict=True)
        ]
        n_frames += table.num_rows
    _write_table(folder / "meta/episodes/chunk-000/file-000.parquet", _columns(episodes))
    _write_tasks(folder / "meta/tasks.parquet")
    _write_json(folder / "meta/stats.json", {name: each.told() for name, each in moments.items() if each.n})
    _write_json(folder / "meta/info.json", _info(scenario, len(episodes), n_frames))


def _frames(rows: dict[str, list[Any]], n_before: int) -> dict[str, Any]:
    """The columns of some frames, of which so many come before."""
    n = len(rows["frame_index"])
    reward = np.array(rows["next.sensed"], dtype=np.float32) - np.array(
        rows["observation.sensed"], np.float32
    )
    return {
        "observation.state": np.array(rows["observation.tip"], dtype=np.float32).reshape(n, 6),
        "action": np.array(rows["action"], dtype=np.float32).reshape(n, 6),
        "observation.time": np.array(rows["timestamp"], dtype=np.float32),
        "next.reward": reward,
        "next.done": np.array(rows["next.done"], dtype=np.bool_),
        "timestamp": np.array(rows["frame_index"], dtype=np.float32) / FPS,
        "frame_index": np.array(rows["frame_index"], dtype=np.int64),
        "episode_index": np.array(rows["episode_index"], dtype=np.int64),
        "index": np.arange(n_before, n_before + n, dtype=np.int64),
        "task_index": np.zeros(n, dtype=np.int64),
    }


def _episode(number: int, first: int, length: int, chunk: int, file: int) -> dict[str, Any]:
    return {
        "episode_index": number,
        "tasks": [TASK],
        "length": length,
        "data/chunk_index": chunk,
        "data/file_index": file,
        "dataset_from_index": first,
        "dataset_to_index": first + length,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }


def _columns(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


def _info(scenario: str, n_episodes: int, n_frames: int) -> dict[str, Any]:
    return {
        "codebase_version": VERSION,
        "robot_type": f"sounding-{scenario}",
        "total_episodes": n_episodes,
        "total_frames": n_frames,
        "total_tasks": 1,
        "chunks_size": FILES_A_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": FPS,
        "splits": {"train": f"0:{n_episodes}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": FEATURES,
    }


def _write_table(path: Path, columns: dict[str, Any], metadata: dict[str, str] | None = None) -> None:
    """Write a Parquet file; rows of one length are lists of that length."""
    pa = pyarrow()
    arrays = {
        name: pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
        if isinstance(values, np.ndarray) and values.ndim == 2
        else pa.array(values)
        for name, values in columns.items()
    }
    table = pa.table(arrays)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        pa.parquet.write_table(table.replace_schema_metadata(metadata), file)


def _write_tasks(path: Path) -> None:
    """Write the one task, whose text is the index that pandas makes of the second column."""
    index = "__index_level_0__"
    described = [
        {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": stored, "metadata": None}
        for name, field, kind, stored in (
            ("task_index", "task_index", "int64", "int64"),
            (None, index, "unicode", "object"),
        )
    ]
    pandas = {"index_columns": [index], "column_indexes": [], "columns": described, "pandas_version": "2.0.0"}
    columns = {"task_index": np.zeros(1, dtype=np.int64), index: [TASK]}
    _write_table(path, columns, {"pandas": json.dumps(pandas)})


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        file.write((json.dumps(content, indent=4) + "\n").encode())

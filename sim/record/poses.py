"""The sensing poses of a run as tables for other programs: poses.csv as it goes, poses.json at its end.

Every frame is named. `T_world_probe` maps probe coordinates to the world's, the probe's frame being that of its tip
with +z along the beam; `T_organ_probe` maps them to the frame of the organ's file. Metres; quaternions are wxyz.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapping.storage import replacing
from sim.errors import UsageError
from sim.tables import read_rows
from sim.world.frames import quaternion_matrix

POSES_CSV, POSES_JSON = "poses.csv", "poses.json"
READINGS_CSV = "readings.csv"
"""The poses of all readings of a run that sensed along the way, with their time since the action began."""
FRAMES = {
    "world": "z up, right-handed; the top of the table is z = 0",
    "organ": "the axes of the organ's file, in metres; for a patient LPS: +x left, +y posterior, +z head",
    "probe": "origin at the tip of the probe, +z along the beam, into the organ",
    "T_a_b": "maps coordinates in b to coordinates in a",
}
QUATERNION_ORDER = "wxyz"


def pose_row(
    step: int, pose_index: int, T_world_probe: ArrayLike, T_world_organ: ArrayLike
) -> dict[str, float | int]:
    """A row of poses.csv: where the probe really was, in the world and in the organ's frame.

    Args:
        step: The action, from 1.
        pose_index: Index of the pose in the workspace.
        T_world_probe: The tip's frame, shape (4, 4).
        T_world_organ: The organ's frame, shape (4, 4).
    """
    T_organ_probe = np.linalg.inv(np.asarray(T_world_organ)) @ np.asarray(T_world_probe)
    row: dict[str, float | int] = {"step": step, "pose_index": pose_index}
    for frame, T in (("world", np.asarray(T_world_probe)), ("organ", T_organ_probe)):
        name = f"T_{frame}_probe"
        row |= {f"{name}_position_{axis}_m": float(T[i, 3]) for i, axis in enumerate("xyz")}
        row |= {f"{name}_quaternion_{axis}": value for axis, value in zip("wxyz", _wxyz(T), strict=True)}
    return row


def read_poses(folder: Path, name: str = POSES_CSV) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The steps of poses.csv, or of readings.csv, shape (T,), and their T_world_probe, shape (T, 4, 4).

    Raises:
        UsageError: The file is missing or broken.
    """
    rows = read_rows(folder / name)
    try:
        numbers = [_numbers(row) for row in rows]
        poses = [_matrix(row) for row in numbers]
    except (ValueError, KeyError) as error:
        raise UsageError(f"{folder / name}: cannot be read ({error}). Run the episode again.") from error
    steps = [int(row["step"]) for row in numbers]
    return np.array(steps, dtype=np.int64), np.array(poses).reshape(-1, 4, 4)


def write_poses_json(folder: Path, T_world_organ: ArrayLike) -> None:
    """Write poses.json from poses.csv."""
    document = poses_document([_numbers(row) for row in read_rows(folder / POSES_CSV)], T_world_organ)
    with replacing(folder / POSES_JSON) as file:
        file.write((json.dumps(document, indent=1) + "\n").encode())


def poses_document(rows: Sequence[Mapping[str, Any]], T_world_organ: ArrayLike) -> dict[str, Any]:
    """The content of poses.json.

    Args:
        rows: As `pose_row` makes them.
        T_world_organ: The organ's frame, shape (4, 4).
    """
    return {
        "unit": "m",
        "quaternion_order": QUATERNION_ORDER,
        "frames": FRAMES,
        "T_world_organ": np.asarray(T_world_organ).tolist(),
        "poses": [
            {"step": row["step"], "pose_index": row["pose_index"]}
            | {name: _pose_of(row, name) for name in ("T_world_probe", "T_organ_probe")}
            for row in rows
        ],
    }


def _pose_of(row: Mapping[str, Any], name: str) -> dict[str, list[float]]:
    return {
        "position_m": [row[f"{name}_position_{axis}_m"] for axis in "xyz"],
        "quaternion_wxyz": [row[f"{name}_quaternion_{axis}"] for axis in "wxyz"],
    }


def _wxyz(T: NDArray[np.float64]) -> list[float]:
    """The rotation of a transform as a unit quaternion with w >= 0."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).ravel())
    return (quaternion if quaternion[0] >= 0 else -quaternion).tolist()


def _matrix(row: Mapping[str, float]) -> NDArray[np.float64]:
    """The T_world_probe of a row, shape (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = quaternion_matrix([row[f"T_world_probe_quaternion_{axis}"] for axis in "wxyz"])
    T[:3, 3] = [row[f"T_world_probe_position_{axis}_m"] for axis in "xyz"]
    return T


def _numbers(row: Mapping[str, str]) -> dict[str, float | int]:
    whole = ("step", "pose_index")
    return {name: int(cell) if name in whole else float(cell) for name, cell in row.items()}

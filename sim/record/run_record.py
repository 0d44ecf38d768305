"""The record of a run: all that its folder holds, whether it was finished or not."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner import Cone
from sim.errors import UsageError
from sim.tables import read_rows
from sim.world.anatomy.anatomy import Anatomy

from .map_field import MapField
from .map_history import TARGETS, TUMOURS, read_history
from .ownership import MANIFEST, check_run_folder
from .poses import READINGS_CSV, read_poses
from .trajectories import ANATOMY, read_anatomy, read_places

Rows = list[dict[str, str]]


@dataclass(frozen=True, eq=False, kw_only=True)
class RunRecord:
    """An episode as its folder tells it."""

    folder: Path
    config: Mapping[str, Any]
    """What config.json holds."""
    manifest: Mapping[str, Any]
    """What manifest.json holds."""
    summary: Mapping[str, Any]
    """What summary.json holds; empty for a run that was killed."""
    steps: Rows
    """Rows of steps.csv."""
    skipped: Rows
    """Rows of skipped.csv."""
    T_world_probe: NDArray[np.float64]
    """Where the probe was at each action, shape (T, 4, 4). Where the organ did not lie as planned, this is where the
    probe truly was in it, in the world in which it does; `poses.csv` has what was believed of that."""
    anatomy: Anatomy
    detection_points_m: NDArray[np.float64]
    """Points inside the tumours, world frame, shape (D, 3)."""
    detection_tumours: NDArray[np.int64]
    """The tumour that each of them lies in, shape (D,)."""
    field: MapField | None
    """The last map; None where the run kept none."""
    history: dict[int, NDArray[np.float32]]
    """The log-odds at the search points after each action whose map was kept."""
    target: RunRecord | None = None
    """The same run as a record of the second class, where one was mapped: its bodies, map and curves stand in the
    place of the tumours'."""
    is_attainable: NDArray[np.bool_] | None = None
    """Which detection points reachable poses can sense, shape (D,); None where an older run did not keep it."""
    readings: tuple[NDArray[np.int64], NDArray[np.float64]] | None = None
    """The action of each reading, shape (R,), and where the probe was, shape (R, 4, 4), of a run that sensed along the
    way; None where there is one reading an action."""
    deviation: NDArray[np.float64] | None = None
    """Standard deviation of the last map's latent at the search points, shape (M,); None where it is not told."""

    @property
    def options(self) -> Mapping[str, Any]:
        """The episode's options."""
        return self.config["options"]

    @property
    def scenario(self) -> Mapping[str, Any]:
        """The episode's scenario."""
        return self.config["scenario"]

    @property
    def cone(self) -> Cone:
        """What the probe senses."""
        return Cone(self.scenario["cone_half_angle_rad"], self.scenario["cone_depth_m"])

    @property
    def T_world_organ(self) -> NDArray[np.float64]:
        """The frame of the organ's file, shape (4, 4)."""
        return np.array(self.config["T_world_organ"], dtype=np.float64)

    @property
    def n_steps(self) -> int:
        """The number of actions that were done."""
        return len(self.T_world_probe)

    def is_seen(self) -> NDArray[np.bool_]:
        """Which detection points lay in the cone of each action, shape (T, D)."""
        seen = np.zeros((self.n_steps, len(self.detection_points_m)), dtype=bool)
        steps, T_world_probe = self.readings or (np.arange(1, self.n_steps + 1), self.T_world_probe)
        for step, T in zip(steps, T_world_probe, strict=True):
            if step <= self.n_steps:
                seen[step - 1] |= self.cone.contains(self.detection_points_m, T[:3, 3], T[:3, 2])
        return seen

    def numbers(self, column: str) -> NDArray[np.float64]:
        """A column of steps.csv, shape (T,); NaN where a cell is empty or the column is not there."""
        return np.array([float(row.get(column) or "nan") for row in self.steps], dtype=np.float64)


def load_run(folder: Path | str) -> RunRecord:
    """The record of the run in a folder.

    Raises:
        UsageError: The folder is not that of an episode, or one of its files is missing or broken.
    """
    folder = Path(folder)
    check_run_folder(folder)
    config, manifest = _json(folder / "config.json"), _json(folder / MANIFEST)
    if not {"options", "scenario", "T_world_organ"} <= config.keys():
        raise UsageError(f"{folder}: is not the folder of an episode.")
    anatomy = read_anatomy(folder)
    points_m, tumours, is_attainable = _detection(folder / ANATOMY)
    n_steps, T_world_probe = read_poses(folder)
    places = read_places(folder)
    for row, step in enumerate(n_steps.tolist()):
        if step in places:
            T_world_probe[row] = places[step].T_rest_probe
    # A kill may leave one row more in one of the two tables.
    steps = read_rows(folder / "steps.csv")[: len(n_steps)]
    field = _field(folder / "map.npz")
    record = RunRecord(
        folder=folder,
        config=config,
        manifest=manifest,
        summary=_json(folder / "summary.json") if (folder / "summary.json").is_file() else {},
        steps=steps,
        skipped=read_rows(folder / "skipped.csv"),
        T_world_probe=T_world_probe[: len(steps)],
        anatomy=anatomy,
        detection_points_m=points_m,
        detection_tumours=tumours,
        is_attainable=is_attainable,
        readings=read_poses(folder, READINGS_CSV) if (folder / READINGS_CSV).is_file() else None,
        field=field,
        history={} if field is None else _history(folder, TUMOURS, field.n_inside, len(steps)),
        deviation=_deviation(folder / "map.npz", field),
    )
    return record if anatomy.target is None else replace(record, target=_of_target(record, anatomy.target))


def _of_target(record: RunRecord, anatomy: Anatomy) -> RunRecord:
    """The record of the second class."""
    folder, n_steps = record.folder, len(record.steps)
    points_m, bodies, is_attainable = _detection(folder / ANATOMY, "target_")
    field = _field(folder / "map.npz", "target_")
    own = ("auprc", "sensed_fraction")
    return replace(
        record,
        steps=[row | {name: row.get(f"target_{name}", "") for name in own} for row in record.steps],
        anatomy=anatomy,
        detection_points_m=points_m,
        detection_tumours=bodies,
        is_attainable=is_attainable,
        field=field,
        history={} if field is None else _history(folder, TARGETS, field.n_inside, n_steps),
        deviation=_deviation(folder / "map.npz", field, "target_"),
    )


def _history(folder: Path, of: str, n_points: int, n_steps: int) -> dict[int, NDArray[np.float32]]:
    """The kept maps of the steps that were written, without those of another size than the last map."""
    kept = read_history(folder, of).items()
    return {step: log_odds for step, log_odds in kept if len(log_odds) == n_points and step <= n_steps}


def _json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        if not isinstance(content, dict):
            raise ValueError("holds no object")
        return content
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read ({error}). Run the episode again.") from error


def _detection(
    path: Path, prefix: str = ""
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_] | None]:
    """The detection points of a class, the body of each, and which of them reachable poses can sense."""
    with np.load(path, allow_pickle=False) as arrays:
        if "detection_points_m" not in arrays.files:
            # The run is older than the points' place in the file.
            return np.empty((0, 3)), np.empty(0, dtype=np.int64), None
        name = f"{prefix}detection_is_attainable"
        is_attainable = arrays[name] if name in arrays.files else None
        return arrays[f"{prefix}detection_points_m"], arrays[f"{prefix}detection_tumours"], is_attainable


def _field(path: Path, prefix: str = "") -> MapField | None:
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as arrays:
            axes_m = (arrays["x_m"], arrays["y_m"], arrays["z_m"])
            truth = arrays["is_target" if prefix else "is_tumour"]
            return MapField.from_probability(
                axes_m, arrays[f"{prefix}probability"], arrays["is_inside"], truth
            )
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise UsageError(f"{path}: cannot be read ({error}). Run the episode again.") from error


def _deviation(path: Path, field: MapField | None, prefix: str = "") -> NDArray[np.float64] | None:
    """The standard deviation of a map's latent inside the organ; None where the file does not tell it."""
    if field is None:
        return None
    with np.load(path, allow_pickle=False) as arrays:
        name = f"{prefix}latent_variance"
        if name not in arrays.files:
            return None
        variance = np.asarray(arrays[name], dtype=np.float64)[field.is_inside]
    return np.sqrt(np.maximum(np.nan_to_num(variance), 0.0))

"""The recording of a run: its states in time and the scene around them, which is what a replay plays."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from planner import Cone
from sim.episode.moving.motion import Motion
from sim.episode.sweeping.contact_trace import Trace, traces_of
from sim.errors import UsageError
from sim.tables import read_rows
from sim.world.probes.probe import DEFAULT, EMBEDDED, ProbeModel
from sim.world.scene.arm import ArmModel
from sim.world.scene.named_arms import named_arm
from sim.world.scene.scene import Scene, build_scene

from .ownership import check_run_folder
from .poses import READINGS_CSV, read_poses
from .trajectories import PROBE, Places, read_anatomy, read_motions, read_places


@dataclass(frozen=True, eq=False)
class Readings:
    """The readings of a run that sensed along the way, in order."""

    steps: NDArray[np.int64]
    """The action of each, shape (R,)."""
    time_s: NDArray[np.float64]
    """Time since that action began [s], shape (R,)."""
    T_world_probe: NDArray[np.float64]
    """The tip's frame, shape (R, 4, 4)."""

    @property
    def places_m(self) -> NDArray[np.float64]:
        """Where the tip was [m], shape (R, 3)."""
        return self.T_world_probe[:, :3, 3]


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """The states of a run and the scene around them."""

    folder: Path
    scene: Scene
    motions: dict[int, Motion]
    """The motion of each step, in order."""
    sensing_s: float
    """How long the probe stays at the end of each motion."""
    sensed_m: NDArray[np.float64]
    """Positions of the poses that were sensed, shape (n_steps, 3) [m]."""
    places: Mapping[int, Places]
    """Where the organ truly was during the motion of each step; empty where it lay as planned."""
    motion_kind: str
    """How the arm moved: `none` where it jumped, `kinematic` or `servo`."""
    readings: Readings | None = None
    """The readings of a run that sensed along the way; None where there is one at the end of each motion."""

    @property
    def duration_s(self) -> float:
        """The modelled time of the whole procedure [s]."""
        return sum(motion.motion_s + self.sensing_s for motion in self.motions.values())

    def at(self, time_s: float) -> tuple[int, NDArray[np.float64]]:
        """The step at a time of the procedure, and the last state that was recorded before it."""
        step, index = self._index_at(time_s)
        return step, self.motions[step].states[index]

    def T_world_rest_at(self, time_s: float) -> NDArray[np.float64]:
        """Where the organ truly was at a time of the procedure, as the map of its planned place, shape (4, 4)."""
        step, index = self._index_at(time_s)
        return self.places[step].T_world_rest[index] if step in self.places else np.eye(4)

    def T_world_rest_sensed(self, step: int) -> NDArray[np.float64]:
        """Where the organ truly was when the probe sensed, likewise."""
        return self.places[step].T_world_rest[-1] if step in self.places else np.eye(4)

    def tips_rest_m(self, step: int) -> NDArray[np.float64]:
        """The tip's way to an action as seen from the organ, where that was planned [m], shape (S, 3)."""
        tips_m = self.motions[step].tips_m
        if step not in self.places:
            return tips_m
        T = self.places[step].T_world_rest
        return np.einsum("sji,sj->si", T[:, :3, :3], tips_m - T[:, :3, 3])

    def trace(self, until_s: float = math.inf) -> Trace:
        """What the tip went on the organ until a time of the procedure, as seen from where the organ was planned."""
        begins_s = self.begins_s
        end_s = np.concatenate([begins_s[step] + trace.end_s for step, trace in self._traces.items()])
        is_gone = end_s <= until_s
        pieces_m = np.concatenate([trace.pieces_m for trace in self._traces.values()])
        return Trace(pieces_m[is_gone], end_s[is_gone])

    def read_m(self, until_s: float) -> NDArray[np.float64]:
        """Where readings had been taken by a time of the procedure, as seen from the organ [m], shape (R, 3)."""
        if self.readings is None:
            return self.sensed_m[: list(self.motions).index(self.at(until_s)[0])]
        begins_s = self.begins_s
        read_s = np.array([begins_s.get(step, math.inf) for step in self.readings.steps.tolist()])
        return self.readings.places_m[read_s + self.readings.time_s <= until_s + 1e-9]

    @property
    def begins_s(self) -> dict[int, float]:
        """When each action began [s]."""
        seconds = [motion.motion_s + self.sensing_s for motion in self.motions.values()]
        return dict(zip(self.motions, np.cumsum([0.0, *seconds[:-1]]).tolist(), strict=True))

    @cached_property
    def _traces(self) -> dict[int, Trace]:
        tips_m = [self.tips_rest_m(step) for step in self.motions]
        return dict(zip(self.motions, traces_of(list(self.motions.values()), tips_m), strict=True))

    def _index_at(self, time_s: float) -> tuple[int, int]:
        """The step at a time of the procedure, and which state of its motion was the last before it."""
        steps = list(self.motions)
        ends_s = np.cumsum([motion.motion_s + self.sensing_s for motion in self.motions.values()])
        row = min(int(np.searchsorted(ends_s, time_s, side="right")), len(steps) - 1)
        motion = self.motions[steps[row]]
        since_s = time_s - (ends_s[row] - motion.motion_s - self.sensing_s)
        index = int(np.searchsorted(motion.time_s, since_s, side="right")) - 1
        return steps[row], max(index, 0)


def read_recording(folder: Path) -> Recording:
    """The recording in a run's folder.

    Raises:
        UsageError: The folder is not that of an episode, or one of its files is missing or broken.
        WorldError: The arm's file is gone.
    """
    config = _config(folder)
    options, scenario = config["options"], config["scenario"]
    arm = None if options["arm"] == "none" else _arm(options)
    cone = Cone(scenario["cone_half_angle_rad"], scenario["cone_depth_m"])
    motions = read_motions(folder)
    scene = build_scene(read_anatomy(folder), cone, arm=arm, probe=_probe(folder, options))
    width = scene.model.nq or 7
    if any(motion.states.shape[1] != width for motion in motions.values()):
        raise UsageError(
            f"{folder}: its states do not fit the arm {options['arm']}, which has changed since."
        )
    sensed_m = [
        [float(row[f"position_{axis}_m"]) for axis in "xyz"] for row in read_rows(folder / "steps.csv")
    ]
    return Recording(
        folder=folder,
        scene=scene,
        motions=motions,
        # The motion of a sweep has the time of sensing in it.
        sensing_s=0.0 if options.get("sense") == "sweep" else float(options["sensing_s"]),
        sensed_m=np.array(sensed_m).reshape(-1, 3),
        places=read_places(folder),
        motion_kind=str(options.get("motion", "none")),
        readings=_readings(folder) if (folder / READINGS_CSV).is_file() else None,
    )


def _readings(folder: Path) -> Readings:
    """The readings of a run that sensed along the way.

    Raises:
        UsageError: Their table is broken.
    """
    steps, T_world_probe = read_poses(folder, READINGS_CSV)
    try:
        time_s = np.array([float(row["time_s"]) for row in read_rows(folder / READINGS_CSV)])
    except (ValueError, KeyError) as error:
        raise UsageError(
            f"{folder / READINGS_CSV}: cannot be read ({error}). Run the episode again."
        ) from error
    return Readings(steps, time_s, T_world_probe)


def _arm(options: dict[str, Any]) -> ArmModel:
    """The arm of a run, at the place where it stood."""
    x_mm, y_mm, z_mm = options["base_mm"]
    return named_arm(
        options["arm"],
        options["flange"],
        base_m=(x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3),
        base_yaw_rad=math.radians(options["base_yaw_deg"]),
    )


def _probe(folder: Path, options: dict[str, Any]) -> ProbeModel:
    """The probe of a run as its folder keeps it; runs of older versions had the embedded one."""
    return ProbeModel(path=folder / PROBE) if options.get("probe", DEFAULT) != DEFAULT else EMBEDDED


def set_state(scene: Scene, data: mujoco.MjData, state: NDArray[np.float64]) -> None:
    """Bring a scene to a recorded state."""
    if scene.free_probe:
        data.mocap_pos[0], data.mocap_quat[0] = state[:3], state[3:]
    else:
        data.qpos[:] = state
    mujoco.mj_fwdPosition(scene.model, data)


def _config(folder: Path) -> dict[str, Any]:
    check_run_folder(folder)
    try:
        config = json.loads((folder / "config.json").read_text(encoding="utf-8-sig"))
        if not {"arm", "flange", "sensing_s"} <= config["options"].keys():
            raise KeyError("sensing_s")
        return config
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{folder}: is not the folder of an episode with recorded motion.") from error

"""The program behind `sounding replay`: what happened in a run, from its recorded states alone."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from planner import Cone
from sim.cli.arm_options import check_base
from sim.cli.replay_options import ReplayOptions
from sim.episode.motion import Motion
from sim.errors import UsageError
from sim.record.locked_folder import MANIFEST
from sim.record.run_folder import read_rows
from sim.record.trajectories import read_anatomy, read_motions
from sim.world.scene.arm import ArmModel
from sim.world.scene.named_arms import named_arm
from sim.world.scene.scene import Scene, build_scene

AGREEMENT_M = 1e-6
"""Recorded tips and those of the recorded states agree to this, or something was changed since."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """A run as it was recorded."""

    folder: Path
    scene: Scene
    motions: dict[int, Motion]
    """By step, in order."""
    sensing_s: float
    """How long the probe stays at the end of each motion."""
    sensed_m: NDArray[np.float64]
    """The poses' positions, shape (n_steps, 3) [m]."""

    @property
    def duration_s(self) -> float:
        """Modelled time of the whole procedure."""
        return sum(motion.motion_s + self.sensing_s for motion in self.motions.values())

    def at(self, time_s: float) -> tuple[int, NDArray[np.float64]]:
        """The step at a time of the procedure, and the last state recorded until then."""
        steps = list(self.motions)
        ends_s = np.cumsum([motion.motion_s + self.sensing_s for motion in self.motions.values()])
        row = min(int(np.searchsorted(ends_s, time_s, side="right")), len(steps) - 1)
        motion = self.motions[steps[row]]
        since_s = time_s - (ends_s[row] - motion.motion_s - self.sensing_s)
        index = int(np.searchsorted(motion.time_s, since_s, side="right")) - 1
        return steps[row], motion.states[max(index, 0)]


def read_recording(folder: Path) -> Recording:
    """Read a run's folder.

    Raises:
        UsageError: It is not the folder of an episode, or one of its files is missing or broken.
        WorldError: The arm's file is gone.
    """
    config = _config(folder)
    options, scenario = config["options"], config["scenario"]
    arm = None if options["arm"] == "none" else _arm(options)
    cone = Cone(scenario["cone_half_angle_rad"], scenario["cone_depth_m"])
    motions = read_motions(folder)
    scene = build_scene(read_anatomy(folder), cone, arm=arm)
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
        sensing_s=float(options["sensing_s"]),
        sensed_m=np.array(sensed_m).reshape(-1, 3),
    )


def _arm(options: dict[str, Any]) -> ArmModel:
    """The arm of a run where it stood."""
    x_mm, y_mm, z_mm = options["base_mm"]
    check_base((x_mm, y_mm, z_mm), options["base_yaw_deg"])
    base_m, yaw_rad = (x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3), math.radians(options["base_yaw_deg"])
    return named_arm(options["arm"], options["flange"], base_m=base_m, base_yaw_rad=yaw_rad)


def set_state(scene: Scene, data: mujoco.MjData, state: NDArray[np.float64]) -> None:
    """Bring a scene to a recorded state."""
    if scene.free_probe:
        data.mocap_pos[0], data.mocap_quat[0] = state[:3], state[3:]
    else:
        data.qpos[:] = state
    mujoco.mj_fwdPosition(scene.model, data)


def run_replay(options: ReplayOptions) -> str:
    """Replay a run; returns what is to be printed.

    Raises:
        UsageError, WorldError: The run cannot be read, or the video cannot be written.
    """
    if options.video is not None:
        from .video import write_video

        recording = read_recording(options.folder)
        n_frames = write_video(recording, options)
        return f"{_table(recording)}\nwrote {n_frames} frames to {options.video}"
    return _table(read_recording(options.folder))


def _table(recording: Recording) -> str:
    """A line per action: states, seconds, ways, and where the tip ended by forward kinematics."""
    data = recording.scene.new_data()
    lines = [f"{'step':>5} {'states':>7} {'motion [s]':>10} {'tip [m]':>8} {'tip to pose [mm]':>17}  states"]
    for index, (step, motion) in enumerate(recording.motions.items()):
        worst_m = 0.0
        for state, tip_m in zip(motion.states, motion.tips_m, strict=True):
            set_state(recording.scene, data, state)
            worst_m = max(worst_m, float(np.linalg.norm(data.site(recording.scene.tip_site).xpos - tip_m)))
        verdict = "as recorded" if worst_m < AGREEMENT_M else f"off by up to {worst_m * 1e3:.3g} mm"
        gap = "–"
        if index < len(recording.sensed_m):
            gap_m = np.linalg.norm(motion.tips_m[-1] - recording.sensed_m[index])
            gap = f"{gap_m * 1e3:.3f}"
        numbers = (
            f"{step:>5} {len(motion.states):>7} {motion.motion_s:>10.2f} {motion.tip_path_m:>8.3f} {gap:>17}"
        )
        lines.append(f"{numbers}  {verdict}")
    n, total_s = len(recording.motions), recording.duration_s
    return "\n".join(
        [*lines, f"{n} actions, procedure {total_s:.1f} s, of which sensing {n * recording.sensing_s:.1f} s"]
    )


def _config(folder: Path) -> dict[str, Any]:
    if not (folder / MANIFEST).is_file():
        raise UsageError(f"{folder}: holds no run. Name the folder that `sounding episode` wrote.")
    try:
        config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
        if not {"arm", "flange", "sensing_s"} <= config["options"].keys():
            raise KeyError("sensing_s")
        return config
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{folder}: is not the folder of an episode with recorded motion.") from error

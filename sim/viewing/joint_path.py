"""The timed path of a run's joints as a file: a table, or a JointTrajectory message of ROS as JSON."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import UsageError
from sim.record.recording import Recording
from sim.world.ik.chain import Chain

NS = 1_000_000_000
"""Nanoseconds in a second."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint positions in time, from the first motion to the end of the last sensing."""

    names: list[str]
    """Of the joints between base and flange, as in the arm's file."""
    is_slide: NDArray[np.bool_]
    """Which of them slide, shape (n,)."""
    time_s: NDArray[np.float64]
    """Of the procedure, strictly rising from 0, shape (N,)."""
    q: NDArray[np.float64]
    """[rad, for slides m], shape (N, n)."""
    steps: NDArray[np.int64]
    """The action that each row belongs to, shape (N,)."""
    phases: NDArray[np.int64]
    """0 lift, 1 transfer, 2 descent, 3 hold, shape (N,)."""


def joint_path(recording: Recording) -> JointPath:
    """The path of a recording. While the probe senses, the joints stay where the motion ended.

    Raises:
        UsageError: The run has no arm, or its arm jumped from pose to pose, so that nothing is known in between.
    """
    if recording.scene.free_probe:
        raise UsageError(f"{recording.folder}: its probe flies freely (`arm` none), so there are no joints.")
    if recording.motion_kind == "none":
        raise UsageError(
            f"{recording.folder}: its arm jumped from pose to pose (`motion` none), and nobody looked at the way "
            "between. Run the episode again with `motion` kinematic or servo."
        )
    chain, begin_s = Chain(recording.scene), 0.0
    times, states, steps, phases = [], [], [], []
    for step, motion in recording.motions.items():
        times += [begin_s + motion.time_s, np.array([begin_s + motion.motion_s + recording.sensing_s])]
        states += [motion.states, motion.states[-1:]]
        phases += [motion.phases, motion.phases[-1:]]
        steps.append(np.full(len(motion.time_s) + 1, step))
        begin_s += motion.motion_s + recording.sensing_s
    time_s = np.concatenate(times)
    # A motion begins where the last sensing ended: of rows of one time, to the nanosecond, the first is kept.
    rows = np.unique(np.round(time_s * NS).astype(np.int64), return_index=True)[1]
    return JointPath(
        names=chain.names,
        is_slide=chain.is_slide,
        time_s=time_s[rows],
        q=np.vstack(states)[rows][:, chain.columns],
        steps=np.concatenate(steps)[rows],
        phases=np.concatenate(phases).astype(np.int64)[rows],
    )


def write_joint_path(path: JointPath, file: Path) -> None:
    """Write a path as its file's name ends: .csv or .json.

    Raises:
        UsageError: The file cannot be written.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        if file.suffix.lower() == ".json":
            file.write_text(json.dumps(joint_trajectory(path), indent=1) + "\n", encoding="utf-8")
            return
        with file.open("w", newline="", encoding="utf-8") as stream:
            units = np.where(path.is_slide, "m", "rad")
            writer = csv.writer(stream)
            writer.writerow(["time_s", "step", "phase", *map("{}_{}".format, path.names, units)])
            writer.writerows(
                [time_s, step, phase, *q]
                for time_s, step, phase, q in zip(
                    path.time_s.tolist(),
                    path.steps.tolist(),
                    path.phases.tolist(),
                    path.q.tolist(),
                    strict=True,
                )
            )
    except OSError as error:
        raise UsageError(f"{file}: cannot be written ({error.strerror}).") from error


def joint_trajectory(path: JointPath) -> dict[str, Any]:
    """The path as the fields of a trajectory_msgs/JointTrajectory of ROS 2, positions alone."""
    ns = np.round(path.time_s * NS).astype(np.int64).tolist()
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": path.names,
        "points": [
            {
                "positions": q,
                "velocities": [],
                "accelerations": [],
                "effort": [],
                "time_from_start": {"sec": at // NS, "nanosec": at % NS},
            }
            for at, q in zip(ns, path.q.tolist(), strict=True)
        ],
    }

"""An episode as arrays: what each action did, saw and led to believe, and the truth that it was to find."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.episode.episode import Episode
from sim.episode.step import Step
from sim.running.parts import EpisodeParts
from sim.world.sensing.sweep import Sweep

from .pictures import mask_of_picture, place_of_picture

PER_CENT = 100
"""A probability is kept as whole per cent."""
STEP_FIELDS = {
    "frame_index": "number of the action within its episode, from 0",
    "timestamp": "modelled time at which the action's reading was taken, since the episode began [s]",
    "observation.tip": "the tip before the action: position [m, world] and direction of the beam; 0 before the first",
    "observation.sensed": "share of the tumours' detection points sensed before the action",
    "observation.auprc": "area under the map's precision-recall curve before the action; 0 without one",
    "action": "the pose that was sensed from: position [m, world] and the direction of the beam",
    "pose_index": "that pose's index in the workspace",
    "T_world_probe": "where the tip was when it sensed, row by row, 4 x 4 [m]",
    "joints": "joints at the contact [rad, or m for slides]; empty for a free-flying probe",
    "motion_s": "time of the motion to the contact [s]",
    "contact_force_n": "force at the contact [N]; NaN where it is not simulated",
    "next.sensed": "share sensed after the action",
    "next.auprc": "area under the curve after the action; 0 without one",
    "next.done": "whether the action is the episode's last",
    "points_m": "points of the reading, x y z one after the other [m, world]",
    "is_occupied": "whether the sensor took each for tumour",
    "is_tumour": "whether each lies in a tumour in truth",
    "belief": "probability of tumour after the action at the points of the lattice in the organ [%]",
    "image": "the middle picture of a sweep, a PNG; null without pictures",
    "image_mask": "which of its pixels are tumour in truth (255), a PNG; null too where the organ lies not as planned",
    "T_world_image": "maps its (column, row, 0) to the world, row by row, 4 x 4 [m]; empty without pictures",
}
"""What is told of each action."""
EPISODE_FIELDS = {
    "seed": "seed of the episode",
    "length": "number of its actions",
    "ended_by": "what ended it",
    "T_world_organ": "maps the organ's own axes to the world, row by row, 4 x 4 [m]",
    "lattice_low_m": "first point of the map's lattice [m, world]",
    "lattice_spacing_m": "its steps along x, y and z [m]",
    "lattice_shape": "its points along x, y and z",
    "is_inside": "which of its points lie in the organ, C order, eight to a byte (numpy.packbits)",
    "is_tumour": "which of those inside lie in a tumour in truth, eight to a byte",
    "lesion_centre_m": "middles of the tumours, x y z one after the other [m, world]",
    "lesion_diameter_m": "diameters of balls of their volumes [m]",
    "sensed": "share of the detection points sensed at the end",
    "auprc": "area under the map's curve at the end; 0 without one",
}
"""What is told of each episode."""


@dataclass(frozen=True, eq=False)
class EpisodeRecord:
    """An episode as plain values and arrays, by the names of the fields."""

    episode: dict[str, Any]
    steps: list[dict[str, Any]] = field(default_factory=list)


def record_of(
    episode: Episode, parts: EpisodeParts, png_of: Callable[[NDArray[np.uint8]], bytes]
) -> EpisodeRecord:
    """Run an episode, and return all of it.

    Args:
        episode: An episode before its first action.
        parts: What it is made of.
        png_of: Packs a grey picture.
    """
    steps: list[dict[str, Any]] = []
    before, time_s = None, 0.0
    for step in episode.steps(parts.n_steps, **parts.stops):
        time_s += step.procedure_s
        steps.append(_row(episode, step, before, time_s, png_of))
        before = steps[-1]
    if steps:
        steps[-1]["next.done"] = True
    return EpisodeRecord(_of_episode(episode, parts, steps), steps)


def _row(
    episode: Episode,
    step: Step,
    before: dict[str, Any] | None,
    time_s: float,
    png_of: Callable[[NDArray[np.uint8]], bytes],
) -> dict[str, Any]:
    """A row of the steps."""
    reading, T = step.reading, step.reading.T_world_probe
    tip = np.concatenate([T[:3, 3], T[:3, 2]]).astype(np.float32)
    prediction, force = episode.prediction, step.motion.contact_force_n
    belief = np.empty(0) if prediction is None else prediction.probability * PER_CENT
    has_truth = len(reading.points_m) > 0
    return {
        "frame_index": step.step - 1,
        "timestamp": time_s,
        "observation.tip": np.zeros(6, np.float32) if before is None else before["action"],
        "observation.sensed": 0.0 if before is None else before["next.sensed"],
        "observation.auprc": 0.0 if before is None else before["next.auprc"],
        "action": tip,
        "pose_index": step.pose_index,
        "T_world_probe": T.ravel(),
        "joints": np.asarray(step.ik.q, dtype=np.float64),
        "motion_s": step.motion.motion_s,
        "contact_force_n": float("nan") if force is None else force,
        "next.sensed": step.sensed_fraction or 0.0,
        "next.auprc": step.auprc or 0.0,
        "next.done": False,
        "points_m": reading.points_m.astype(np.float32).ravel(),
        "is_occupied": reading.is_occupied,
        "is_tumour": _truth(episode, reading.points_m) if has_truth else np.empty(0, dtype=bool),
        "belief": np.rint(belief).astype(np.uint8),
    } | _picture(episode, reading.images, png_of)


def _picture(
    episode: Episode, sweep: Sweep | None, png_of: Callable[[NDArray[np.uint8]], bytes]
) -> dict[str, Any]:
    """What is kept of a sweep's pictures."""
    if sweep is None:
        return {"image": None, "image_mask": None, "T_world_image": np.empty(0)}
    is_planned = episode.body is None
    return {
        "image": png_of(sweep.images[sweep.middle]),
        "image_mask": png_of(mask_of_picture(sweep, episode.truth.anatomy)) if is_planned else None,
        "T_world_image": place_of_picture(sweep).ravel(),
    }


def _truth(episode: Episode, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether points lie in a tumour; where the body has moved, what is told is of where they were taken to be."""
    return episode.truth.anatomy.is_tumour(points_m)


def _of_episode(episode: Episode, parts: EpisodeParts, steps: list[dict[str, Any]]) -> dict[str, Any]:
    """The row of the episode."""
    setup, tumours = episode.setup, episode.truth.anatomy.tumours
    axes_m, last = setup.query.axes_m, steps[-1] if steps else {}
    volumes_m3 = np.array([each.volume_m3 for each in tumours])
    centres_m = np.array([np.mean(each.bounds_m, axis=0) for each in tumours]).reshape(-1)
    return {
        "seed": parts.seed,
        "length": len(steps),
        "ended_by": episode.ended_by or "steps",
        "T_world_organ": setup.T_world_organ.ravel(),
        "lattice_low_m": np.array([axis[0] for axis in axes_m]),
        "lattice_spacing_m": np.array([axis[1] - axis[0] for axis in axes_m]),
        "lattice_shape": np.array(setup.query.shape, dtype=np.int64),
        "is_inside": np.packbits(setup.is_inside),
        "is_tumour": np.packbits(episode.truth.is_tumour),
        "lesion_centre_m": centres_m,
        "lesion_diameter_m": np.cbrt(6.0 * volumes_m3 / np.pi),
        "sensed": last.get("next.sensed", 0.0),
        "auprc": last.get("next.auprc", 0.0),
    }

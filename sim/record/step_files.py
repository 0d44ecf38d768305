"""The files of a run's folder that change with each step of its episode: the tables and the map."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from mapping import DetailedMap, HilbertMap, Prediction
from planner import Workspace
from planner.acquisition import expected_improvement
from sim.episode.attainment import seeable_points
from sim.episode.episode import Episode
from sim.episode.measures import ACTION_SECONDS
from sim.episode.moving.held_force import HELD_CELLS
from sim.episode.setup import Setup
from sim.episode.step import Step
from sim.episode.sweeping.score import SWEEP_CELLS, SweepScore

from .map_history import write_history
from .map_volumes import VISIBLE, map_volumes, maps_in
from .poses import POSES_CSV, READINGS_CSV, pose_row
from .run_folder import BODY_JSON, OWN_MAP, OWN_TARGET_MAP, RunFolder
from .trajectories import write_motion


def write_step(folder: RunFolder, episode: Episode, step: Step) -> None:
    """Append a step to the tables, write its motion and replace the map."""
    positioner, workspace = episode.setup.positioner, episode.setup.workspace
    folder.append_row("steps.csv", _step_row(episode, step))
    for skipped in step.skipped:
        row = {"step": step.step, "pose_index": skipped.pose_index, "reason": skipped.reason}
        row |= place_of(workspace, skipped.pose_index)
        folder.append_row("skipped.csv", row)
    for phase, q in (("above", step.ik.q_standoff), ("contact", step.ik.q), ("above", step.ik.q_standoff)):
        row = {"step": step.step, "phase": phase, "pose_index": step.pose_index}
        folder.append_row("states.csv", row | dict(zip(positioner.joint_names, q, strict=True)))
    truly = None if episode.body is None else episode.body.record_of(step.motion)
    write_motion(folder, step.step, step.motion, truly)
    tip = step.reading.T_world_probe
    folder.append_row(POSES_CSV, pose_row(step.step, step.pose_index, tip, episode.setup.T_world_organ))
    if step.sweep is not None:
        _append_readings(folder, episode, step.step, step.sweep)
    if episode.prediction is not None:
        target = None if episode.target is None else episode.target.prediction
        scores = [each.score for each in (episode.prediction, target) if each is not None]
        write_history(folder, step.step, *scores)
    write_map(folder, episode, is_final=False)
    if episode.body is not None:
        folder.write_json(BODY_JSON, episode.body.record())


def _append_readings(folder: RunFolder, episode: Episode, step: int, sweep: SweepScore) -> None:
    """Append a row to readings.csv for each reading of an action."""
    poses = episode.sensed[len(episode.sensed) - sweep.n_readings :]
    for pose, time_s, T in zip(poses, sweep.read_s, sweep.T_world_readings, strict=True):
        row = pose_row(step, pose, T, episode.setup.T_world_organ)
        folder.append_row(READINGS_CSV, row | {"time_s": time_s})


def _step_row(episode: Episode, step: Step) -> dict[str, Any]:
    """A row of steps.csv."""
    return {
        "step": step.step,
        "pose_index": step.pose_index,
        **place_of(episode.setup.workspace, step.pose_index),
        **dict(zip(episode.setup.positioner.joint_names, step.ik.q, strict=True)),
        "position_error_m": step.ik.position_error_m,
        "angle_error_rad": step.ik.angle_error_rad,
        "n_points": len(step.reading.points_m),
        "n_occupied": int(step.reading.is_occupied.sum()),
        "sensed_fraction": step.sensed_fraction,
        "auprc": step.auprc,
        **_target_cells(step),
        **({} if step.body is None else dataclasses.asdict(step.body)),
        "expected_improvement": best_improvement(episode.prediction),
        "n_skipped": len(step.skipped),
        "motion_s": step.motion.motion_s,
        "procedure_s": step.procedure_s,
        "joint_travel_rad": step.motion.joint_travel_rad,
        "tip_path_m": step.motion.tip_path_m,
        **({} if step.sweep is None else {name: getattr(step.sweep, name) for name in SWEEP_CELLS}),
        "tracking_error_m": step.motion.tracking_error_m,
        "tracking_error_rad": step.motion.tracking_error_rad,
        "contact_force_n": step.motion.contact_force_n,
        **({} if step.motion.force_error_n is None else {"force_error_n": step.motion.force_error_n}),
        "peak_force_n": step.motion.peak_force_n,
        **({} if (held := step.motion.held) is None else {name: getattr(held, name) for name in HELD_CELLS}),
        **{name: getattr(step, name) for name in ACTION_SECONDS},
        **({"confidence": episode.confidence()} if episode.planner.tells_confidence else {}),
    }


def _target_cells(step: Step) -> dict[str, float | None]:
    """The columns about the second class; none where there is no such class."""
    score, labels = step.target, step.reading.is_target
    if score is None:
        return {}
    return {
        "n_target": None if labels is None else int(labels.sum()),
        "target_sensed_fraction": score.sensed_fraction,
        "target_auprc": score.auprc,
    }


def best_improvement(prediction: Prediction | None) -> float | None:
    """The highest expected improvement of the latent that any search point still promises; None without a map."""
    if prediction is None:
        return None
    mean, variance = prediction.latent_mean, prediction.latent_variance
    return float(expected_improvement(mean, variance, incumbent=float(mean.max())).max())


def place_of(workspace: Workspace, pose: int) -> dict[str, float]:
    """The position and the inward normal of a pose as columns."""
    position_m, normal = workspace.positions_m[pose], workspace.normals[pose]
    return {f"position_{axis}_m": position_m[i] for i, axis in enumerate("xyz")} | {
        f"normal_{axis}": normal[i] for i, axis in enumerate("xyz")
    }


def write_map(folder: RunFolder, episode: Episode, *, is_final: bool) -> None:
    """Write the maps as arrays on the query lattice, NaN outside the organ, and the final ones as NIfTI too."""
    setup, prediction, target = episode.setup, episode.prediction, episode.target
    if prediction is None:
        return
    x_m, y_m, z_m = setup.query.axes_m
    is_inside = _on_lattice(setup, np.ones(len(setup.search_points_m), dtype=bool))
    arrays = {"x_m": x_m, "y_m": y_m, "z_m": z_m, **_prediction_arrays(setup, prediction)}
    arrays |= {"is_tumour": _on_lattice(setup, episode.truth.is_tumour), "is_inside": is_inside}
    if target is not None and target.prediction is not None:
        own = _prediction_arrays(setup, target.prediction)
        arrays |= {f"target_{name}": values for name, values in own.items()}
        arrays["is_target"] = _on_lattice(setup, target.truth.is_target)
    folder.write_arrays("map.npz", compressed=is_final, **arrays)
    if is_final:
        is_visible = _on_lattice(setup, seeable_points(episode.setup, episode.skipped))
        folder.write_arrays(VISIBLE, compressed=True, is_visible=is_visible)
        for each in maps_in(arrays, None if target is None else target.name, is_visible):
            for name, content in map_volumes(each, setup.T_world_organ).items():
                folder.write_bytes(name, content)


def write_own_maps(folder: RunFolder, episode: Episode) -> None:
    """Have the maps that a user brought along written by their own `save`; of the built-in ones map.npz tells all."""
    target = None if episode.target is None else episode.target.tumour_map
    for name, own in ((OWN_MAP, episode.tumour_map), (OWN_TARGET_MAP, target)):
        if own is not None and not isinstance(own, HilbertMap | DetailedMap):
            own.save(folder.path / name)


def _prediction_arrays(setup: Setup, prediction: Prediction) -> dict[str, np.ndarray]:
    """The arrays of a map, on the whole lattice."""
    names = ("probability", "latent_mean", "latent_variance")
    return {name: _on_lattice(setup, getattr(prediction, name)) for name in names}


def _on_lattice(setup: Setup, values: np.ndarray) -> np.ndarray:
    """The values of the search points on the whole lattice: NaN, or False, outside the organ."""
    if values.dtype == bool:
        return setup.on_lattice(values, outside=False)
    return setup.on_lattice(values.astype(np.float32), outside=np.nan)

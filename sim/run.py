"""The program behind `sounding episode`: an episode with its progress bar, run folder, frames and figures."""

from __future__ import annotations

import dataclasses
import sys
from contextlib import ExitStack
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from mapping import MapMetrics
from planner import Planner

from .arms import arm_named
from .episode import Episode, Step
from .frames import FrameWriter
from .interrupt import NotedInterrupt
from .motion import ProcedureStoppedError
from .movers import make_mover
from .options import EpisodeOptions
from .recording import RunFolder, check_out_folder
from .run_figures import draw_run_figures
from .stage import Stage, build_stage
from .trajectories import write_anatomy, write_motion
from .world.arm import ArmModel
from .world.rendering import SceneRenderer

SENSED_TARGET = 0.95
"""The paper's measure of detection: this share of the tumours' points was sensed."""
SECONDS = ("plan_s", "ik_s", "move_s", "sense_s", "update_s")
"""Columns of computing time, which no run repeats."""


@dataclass
class Tally:
    """What the steps so far add up to."""

    steps: list[Step] = field(default_factory=list)
    sensings_to_95: int | None = None
    n_skipped_poses: int = 0

    def add(self, step: Step) -> None:
        """Count one more step."""
        self.steps.append(step)
        self.n_skipped_poses += len(step.skipped)
        if self.sensings_to_95 is None and (step.sensed_fraction or 0.0) >= SENSED_TARGET:
            self.sensings_to_95 = step.step

    def seconds(self) -> dict[str, float]:
        """Time by part [s]."""
        return {name: sum(getattr(step, name) for step in self.steps) for name in SECONDS}

    def motion(self) -> dict[str, float | None]:
        """Modelled time of the procedure and ways of joints and tip."""
        travels_rad = [step.motion.joint_travel_rad for step in self.steps]
        return {
            "motion_s": sum(step.motion.motion_s for step in self.steps),
            "procedure_s": sum(step.procedure_s for step in self.steps),
            "joint_travel_rad": None if None in travels_rad else sum(way for way in travels_rad if way),
            "tip_path_m": sum(step.motion.tip_path_m for step in self.steps),
        }


def arm_model(options: EpisodeOptions) -> ArmModel | None:
    """The arm that the options name, None for a free-flying probe."""
    if options.arm == "none":
        return None
    return arm_named(options.arm, options.flange, base_mm=options.base_mm, base_yaw_deg=options.base_yaw_deg)


def make_episode(
    options: EpisodeOptions, stage: Stage, *, planner: Planner | None = None, casts_rays: bool = True
) -> Episode:
    """The episode that the options describe.

    Args:
        options: What to run.
        stage: The options' stage.
        planner: One that ranks as the options' planner does, in its place.
        casts_rays: Whether readings hold points; see `Episode`.

    Raises:
        UsageError, WorldError, PlannerError: Something asked for cannot be done.
    """
    motion_settings = options.make_motion_settings()
    return Episode(
        stage,
        planner or options.make_planner(),
        seed=options.seed,
        map_settings=options.make_map_settings(),
        mover=make_mover(stage, options.motion, motion_settings, options.make_servo_settings()),
        sensing_s=motion_settings.sensing_s,
        has_map=options.keeps_map(),
        casts_rays=casts_rays,
    )


def run_episode(
    options: EpisodeOptions, *, stage: Stage | None = None, show_progress: bool = True
) -> dict[str, Any]:
    """Run an episode and write its folder; returns the summary.

    Args:
        options: What to run.
        stage: The options' stage, where the caller has it already.
        show_progress: Draw a progress bar and print notes on stderr.

    Raises:
        UsageError, WorldError, PlannerError: Something asked for cannot be done; nothing was written then.
        KeyboardInterrupt: Again, after what was done has been written.
    """
    start_s = perf_counter()
    scenario = options.make_scenario()
    out = options.out_folder(scenario)
    check_out_folder(out, overwrite=options.overwrite)
    map_settings = options.make_map_settings()
    options.check()
    with (
        threadpool_limits(limits=1),
        ExitStack() as stack,
    ):  # two BLAS pools on two threads fight; and bytes repeat
        stage = stage or build_stage(scenario, arm_model(options), map_settings)
        episode = make_episode(options, stage)
        renderer = None
        if options.frames != "none":
            renderer = stack.enter_context(SceneRenderer(episode.truth.scene))
        folder = stack.enter_context(RunFolder(out, overwrite=options.overwrite))
        folder.begin(_config(options, stage, map_settings), {"seed": options.seed})
        write_anatomy(folder, episode.truth.anatomy)
        for notice in (*stage.notices, *episode.truth.anatomy.notices) if show_progress else ():
            print(f"note: {notice}", file=sys.stderr)
        interrupt = stack.enter_context(NotedInterrupt())
        return _record(episode, options, folder, renderer, interrupt, start_s, show_progress)


def _record(
    episode: Episode,
    options: EpisodeOptions,
    folder: RunFolder,
    renderer: SceneRenderer | None,
    interrupt: NotedInterrupt,
    start_s: float,
    show_progress: bool,
) -> dict[str, Any]:
    """Run the loop, writing as it goes, and close the folder whatever ends it."""
    tally, setup_s, status = Tally(), perf_counter() - start_s, "finished"
    frames = None
    if renderer is not None:
        (folder.path / "frames").mkdir(exist_ok=True)
        frames = FrameWriter(folder.path / "frames", renderer, episode)
    progress = tqdm(
        total=options.steps, desc="sensing", unit="action", mininterval=0.5, disable=not show_progress
    )
    render_s = 0.0
    try:
        steps = episode.steps(
            options.steps, until_sensed=options.until_sensed, until_confident=options.until_confident
        )
        for step in steps:
            tally.add(step)
            _write_step(folder, episode, step)
            render_start_s = perf_counter()
            if frames is not None and options.frames == "each":
                frames.write(f"{step.step:04d}.png", step)
            render_s += perf_counter() - render_start_s
            progress.set_postfix_str(_postfix(step), refresh=False)
            progress.update()
            if interrupt.is_set:
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        status = "interrupted"
        raise
    except ProcedureStoppedError as error:
        status = "stopped"
        write_motion(folder, len(tally.steps) + 1, error.motion)
        raise
    finally:
        progress.close()
        if frames is not None:
            if options.frames == "last" and tally.steps:
                frames.write("final.png", tally.steps[-1])
            frames.close()
        summary = episode_summary(options, episode, tally, episode.metrics())
        summary |= {
            "folder": str(folder.path),
            "status": status,
            "setup_s": setup_s,
            "render_s": render_s,
            "wall_s": perf_counter() - start_s,
        }
        _close_run(folder, episode, tally, summary)
        folder.finish(status)
    return summary


def _postfix(step: Step) -> str:
    auprc = "–" if step.auprc is None else f"{step.auprc:.2f}"
    sensed = "–" if step.sensed_fraction is None else f"{step.sensed_fraction:.0%}"
    return f"AUPRC {auprc}, sensed {sensed}"


def _config(options: EpisodeOptions, stage: Stage, map_settings: Any) -> dict[str, Any]:
    """Everything needed to repeat the run: the options and what they stand for."""
    return {
        "options": dataclasses.asdict(options),
        "scenario": dataclasses.asdict(stage.scenario),
        "map": dataclasses.asdict(map_settings),
        "T_world_organ": stage.T_world_organ,
        "n_poses": stage.workspace.n_poses,
        "n_hinges": int(stage.hinge_mask.sum()),
        "n_search_points": len(stage.search_points_m),
    }


def _write_step(folder: RunFolder, episode: Episode, step: Step) -> None:
    carrier, workspace = episode.stage.carrier, episode.stage.workspace
    position_m, normal = workspace.positions_m[step.pose_index], workspace.normals[step.pose_index]
    folder.append_row(
        "steps.csv",
        {
            "step": step.step,
            "pose_index": step.pose_index,
            **{f"position_{axis}_m": position_m[i] for i, axis in enumerate("xyz")},
            **{f"normal_{axis}": normal[i] for i, axis in enumerate("xyz")},
            **dict(zip(carrier.joint_names, step.ik.q, strict=True)),
            "position_error_m": step.ik.position_error_m,
            "angle_error_rad": step.ik.angle_error_rad,
            "n_points": len(step.reading.points_m),
            "n_occupied": int(step.reading.is_occupied.sum()),
            "sensed_fraction": step.sensed_fraction,
            "auprc": step.auprc,
            "n_skipped": len(step.skipped),
            "motion_s": step.motion.motion_s,
            "procedure_s": step.procedure_s,
            "joint_travel_rad": step.motion.joint_travel_rad,
            "tip_path_m": step.motion.tip_path_m,
            "tracking_error_m": step.motion.tracking_error_m,
            "tracking_error_rad": step.motion.tracking_error_rad,
            "contact_force_n": step.motion.contact_force_n,
            "peak_force_n": step.motion.peak_force_n,
            **{name: getattr(step, name) for name in SECONDS},
        },
    )
    for skipped in step.skipped:
        row = {"step": step.step, "pose_index": skipped.pose_index, "reason": skipped.reason}
        folder.append_row("skipped.csv", row)
    for phase, q in (("above", step.ik.q_standoff), ("contact", step.ik.q), ("above", step.ik.q_standoff)):
        row = {"step": step.step, "phase": phase, "pose_index": step.pose_index}
        folder.append_row("states.csv", row | dict(zip(carrier.joint_names, q, strict=True)))
    write_motion(folder, step.step, step.motion)
    write_map(folder, episode, is_final=False)


def write_map(folder: RunFolder, episode: Episode, *, is_final: bool) -> None:
    """Write the map as arrays on the query lattice; NaN outside the organ."""
    stage, prediction = episode.stage, episode.prediction
    if prediction is None:
        return

    def on_lattice(values: np.ndarray, fill: float | bool) -> np.ndarray:
        field_values = np.full(stage.query.n_points, fill, dtype=np.float32 if fill is not False else bool)
        field_values[stage.is_inside] = values
        return field_values.reshape(stage.query.shape)

    x_m, y_m, z_m = stage.query.axes_m
    folder.write_arrays(
        "map.npz",
        compressed=is_final,
        x_m=x_m,
        y_m=y_m,
        z_m=z_m,
        probability=on_lattice(prediction.probability, np.nan),
        latent_mean=on_lattice(prediction.latent_mean, np.nan),
        latent_variance=on_lattice(prediction.latent_variance, np.nan),
        is_tumour=on_lattice(episode.truth.is_tumour, False),
        is_inside=stage.is_inside.reshape(stage.query.shape),
    )


def episode_summary(
    options: EpisodeOptions, episode: Episode, tally: Tally, metrics: MapMetrics | None
) -> dict[str, Any]:
    """What an episode came to, as `summary.json` and the rows of trials have it."""
    last = tally.steps[-1] if tally.steps else None
    tumour_of = episode.truth.anatomy.tumour_of(episode.stage.search_points_m)
    return {
        "scenario": episode.stage.scenario.name,
        "planner": options.planner,
        "arm": options.arm,
        "seed": options.seed,
        "n_sensings": len(tally.steps),
        "sensings_to_95": tally.sensings_to_95,
        "sensed_fraction": None if last is None else last.sensed_fraction,
        "attainable_fraction": episode.truth.attainable_fraction,
        **({} if metrics is None else dataclasses.asdict(metrics)),
        "n_points_per_tumour": [
            int((tumour_of == i).sum()) for i in range(len(episode.truth.anatomy.tumours))
        ],
        "confidence": episode.confidence(),
        "n_skipped_poses": tally.n_skipped_poses,
        **tally.motion(),
        **tally.seconds(),
    }


def _close_run(folder: RunFolder, episode: Episode, tally: Tally, summary: dict[str, Any]) -> None:
    """Write the final map, the figures and the summary."""
    write_map(folder, episode, is_final=True)
    if tally.steps:
        draw_run_figures(folder.path, episode, tally.steps)
    folder.write_json("summary.json", summary)

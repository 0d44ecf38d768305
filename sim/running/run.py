"""The program behind `sounding episode`: an episode with its progress bar, run folder, frames and figures."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack
from functools import partial
from time import perf_counter
from typing import Any, NoReturn

from threadpoolctl import threadpool_limits
from tqdm import tqdm

from planner import Planner
from sim.cli.arm_options import check_base
from sim.episode.arm_motion import make_motion_model
from sim.episode.episode import Episode, Step
from sim.episode.motion import ProcedureStoppedError
from sim.episode.setup import Setup, build_setup
from sim.findings.structure_distances import distance_rows
from sim.interrupt import NotedInterrupt
from sim.pictures.frames import EpisodeFrames
from sim.record.locked_folder import check_out_folder
from sim.record.run_folder import RunFolder
from sim.record.step_files import run_config, write_map, write_step
from sim.record.trajectories import write_anatomy, write_motion
from sim.world.scene.arm import ArmModel
from sim.world.scene.named_arms import named_arm
from sim.world.scene.rendering import SceneRenderer

from .options import EpisodeOptions
from .summary import Totals, episode_summary

_MANY_SKIPPED = 100
"""Poses in a row out of the arm's reach from which on that is worth a word."""
_SKIPPED_NOTE = (
    f"note: the arm reaches none of the {_MANY_SKIPPED} poses chosen last; still looking for one that it reaches. "
    "`sounding reach` with the same --arm and --organ shows where there are any, --organ-pose best moves the organ."
)


def arm_model(options: EpisodeOptions) -> ArmModel | None:
    """The arm that the options name, None for a free-flying probe."""
    if options.arm == "none":
        return None
    check_base(options.base_mm, options.base_yaw_deg)
    x_mm, y_mm, z_mm = options.base_mm
    base_m, yaw_rad = (x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3), math.radians(options.base_yaw_deg)
    return named_arm(options.arm, options.flange, base_m=base_m, base_yaw_rad=yaw_rad)


def make_episode(
    options: EpisodeOptions, setup: Setup, *, planner: Planner | None = None, casts_rays: bool = True
) -> Episode:
    """The episode that the options describe.

    Args:
        options: What to run.
        setup: The options' setup.
        planner: One that ranks as the options' planner does, in its place.
        casts_rays: Whether readings hold points; see `Episode`.

    Raises:
        UsageError, WorldError, PlannerError: Something asked for cannot be done.
    """
    motion_settings = options.make_motion_settings()
    return Episode(
        setup,
        planner or options.make_planner(),
        seed=options.seed,
        map_settings=options.make_map_settings(),
        insets=options.make_insets(),
        motion_model=make_motion_model(setup, options.motion, motion_settings, options.make_servo_settings()),
        sensing_s=motion_settings.sensing_s,
        has_map=options.keeps_map(),
        casts_rays=casts_rays,
        plans_for_target=options.plan_for == "target",
    )


def run_episode(
    options: EpisodeOptions, *, setup: Setup | None = None, show_progress: bool = True
) -> dict[str, Any]:
    """Run an episode and write its folder; returns the summary.

    Args:
        options: What to run.
        setup: The options' setup, where the caller has it already.
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
    # One BLAS thread: two pools on two threads fight; and bytes repeat.
    with threadpool_limits(limits=1), ExitStack() as stack:
        setup = setup or build_setup(scenario, arm_model(options), map_settings)
        episode = make_episode(options, setup)
        renderer = None
        if options.frames != "none":
            renderer = stack.enter_context(SceneRenderer(episode.truth.scene))
        folder = stack.enter_context(RunFolder(out, overwrite=options.overwrite))
        folder.begin(run_config(options, setup, map_settings), {"seed": options.seed})
        write_anatomy(folder, episode.truth.anatomy)
        for notice in (*setup.notices, *episode.truth.anatomy.notices) if show_progress else ():
            print(f"note: {notice}", file=sys.stderr)
        recording = _Recording(options, folder, episode, EpisodeFrames(folder.path, episode, renderer))
        interrupt = stack.enter_context(NotedInterrupt())
        return recording.run(interrupt, start_s, show_progress=show_progress)


class _Recording:
    """An episode that is written as it goes, with its folder closed whatever ends it."""

    def __init__(
        self, options: EpisodeOptions, folder: RunFolder, episode: Episode, frames: EpisodeFrames
    ) -> None:
        self._options, self._folder, self._episode, self._frames = options, folder, episode, frames
        self._totals, self._status = Totals(), "finished"
        self._has_told_of_reach = False

    def run(self, interrupt: NotedInterrupt, start_s: float, *, show_progress: bool) -> dict[str, Any]:
        """Sense until the end and return the summary; what began at `start_s` was the set-up until now."""
        setup_s = perf_counter() - start_s
        try:
            self._sense(interrupt, show_progress=show_progress)
        except KeyboardInterrupt:
            self._status = "interrupted"
            raise
        except ProcedureStoppedError as error:
            self._status = "stopped"
            write_motion(self._folder, len(self._totals.steps) + 1, error.motion)
            raise
        finally:
            summary = self._finish(setup_s, start_s)
        return summary

    def _sense(self, interrupt: NotedInterrupt, *, show_progress: bool) -> None:
        options, draws_each = self._options, self._options.frames == "each"
        with tqdm(
            total=options.steps, desc="sensing", unit="action", mininterval=0.5, disable=not show_progress
        ) as progress:
            steps = self._episode.steps(
                options.steps,
                until_sensed=options.until_sensed,
                until_confident=options.until_confident,
                on_skipped=partial(self._tell_skipped, progress, interrupt),
            )
            for step in steps:
                self._totals.add(step)
                write_step(self._folder, self._episode, step)
                if draws_each:
                    self._frames.draw(f"{step.step:04d}.png", step)
                progress.set_postfix_str(_postfix(step), refresh=False)
                progress.update()
                if interrupt.is_set:
                    raise KeyboardInterrupt

    def _tell_skipped(self, progress: tqdm[NoReturn], interrupt: NotedInterrupt, n_in_a_row: int) -> None:
        """Say how the search for a pose within reach goes, which is long where there is hardly any."""
        if interrupt.is_set:
            raise KeyboardInterrupt
        if n_in_a_row < _MANY_SKIPPED:
            return
        progress.set_postfix_str(f"{n_in_a_row} poses in a row out of reach")
        if not (self._has_told_of_reach or progress.disable):
            progress.write(_SKIPPED_NOTE, file=sys.stderr)
        self._has_told_of_reach = True

    def _finish(self, setup_s: float, start_s: float) -> dict[str, Any]:
        """Write the last frame, the final map, the figures and the summary."""
        from sim.pictures.run_figures import draw_run_figures  # see `_publish`

        folder, episode, totals = self._folder, self._episode, self._totals
        if self._options.frames == "last" and totals.steps:
            self._frames.draw("final.png", totals.steps[-1])
        self._frames.close()
        summary = episode_summary(self._options, episode, totals, episode.metrics())
        summary |= {
            "folder": str(folder.path),
            "status": self._status,
            "setup_s": setup_s,
            "render_s": self._frames.draw_s,
            "wall_s": perf_counter() - start_s,
        }
        write_map(folder, episode, is_final=True)
        for row in distance_rows(episode):
            folder.append_row("structures.csv", row)
        if totals.steps:
            draw_run_figures(folder.path, episode, totals.steps)
        folder.write_json("summary.json", summary)
        self._publish()
        return summary

    def _publish(self) -> None:
        """Write what the finished folder comes to, and its report."""
        # Imported here: half a second that the workers of trials, which write no folder, need not wait for.
        from sim.findings.results import write_results
        from sim.record.run_record import load_run
        from sim.report import write_report

        findings = write_results(load_run(self._folder.path))
        self._folder.finish(self._status)
        if self._options.report:
            write_report(self._folder.path, findings)


def _postfix(step: Step) -> str:
    auprc = "–" if step.auprc is None else f"{step.auprc:.2f}"
    sensed = "–" if step.sensed_fraction is None else f"{step.sensed_fraction:.0%}"
    return f"AUPRC {auprc}, sensed {sensed}"

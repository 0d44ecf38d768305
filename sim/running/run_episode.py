"""The program behind `sounding episode`: an episode with its progress bar, run folder, frames, figures and report."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, NoReturn

from threadpoolctl import threadpool_limits
from tqdm import tqdm

from planner import Planner
from sim.episode.episode import Episode
from sim.episode.moving.motion import ProcedureStoppedError
from sim.episode.setup import Setup, build_setup
from sim.episode.step import Step
from sim.findings.structure_distances import distance_rows
from sim.interrupt import NotedInterrupt
from sim.notices import Notify, print_notice
from sim.pictures.bmode import write_sweep
from sim.pictures.frames import EpisodeFrames, frame_renderer
from sim.record.ownership import check_out_folder
from sim.record.run_folder import RunFolder
from sim.record.step_files import write_map, write_own_maps, write_step
from sim.record.trajectories import write_anatomy, write_motion, write_probe

from .config import EpisodeConfig
from .config_file import cannot_repeat, recorded_config, run_config
from .fields import changed, read_config, without_options_of
from .live.showing import shown
from .output import Output, output_of
from .parts import EpisodeParts, make_parts
from .placing.arm_place import arm_fields, probe_text
from .summary import MANY_SKIPPED, SKIPPED_NOTE, Totals, episode_summary, progress_text
from .sweep import motion_model_of

if TYPE_CHECKING:
    from mapping import TumourMapFactory
    from sim.episode.scenario import Scenario
    from sim.findings.findings import Findings
    from sim.world.probes.probe import ProbeModel
    from sim.world.scene.arm import ArmModel
    from sim.world.sensing.sensor import Sensor


def run_episode(
    *,
    scenario: Scenario | str | None = None,
    planner: Planner | str | None = None,
    sensor: Sensor | str | None = None,
    tumour_map: TumourMapFactory | str | None = None,
    arm: ArmModel | str | None = None,
    probe: ProbeModel | str | None = None,
    config: Path | str | None = None,
    show_progress: bool = True,
    **options: Any,
) -> dict[str, Any]:
    """Run an episode and write its folder, with report and everything, as `sounding episode` does.

    Args:
        scenario: A scenario, or the text that names one, such as the path of a scenario's file; by default `liver`.
        planner: A planner, or the text that names one; by default `find-and-outline`. The map has the settings that it
            prefers.
        sensor: A sensor, or the text that names one; by default `cone`.
        tumour_map: What makes the map, such as a class of one's own; or the text that names one, `always` (the default)
            or `when-needed`.
        arm: An arm where it stands, or the text that names one; by default the embedded one.
        probe: A probe, or the path of its file; by default the embedded one.
        config: The config.json of an earlier run, which is run again; what is given beside it takes precedence.
        show_progress: Draw a progress bar and print notes on stderr.
        options: All other fields of an `EpisodeConfig` by name: `steps=10, seed=3, out="renders/mine", arm="none"`.

    Returns:
        The summary, as summary.json has it.

    Raises:
        UsageError, WorldError, PlannerError: Something cannot be done, and nothing was written.
        KeyboardInterrupt: Ctrl-C was pressed; what was done has been written.
    """
    given = {"scenario": scenario, "planner": planner, "sensor": sensor, "map": tumour_map}
    named = {name: value for name, value in given.items() if isinstance(value, str)}
    brought = {name: value for name, value in given.items() if name not in named and value is not None}
    base = (
        EpisodeConfig()
        if config is None
        else without_options_of(read_config(Path(config)), [*named, *brought])
    )
    standing = {} if arm is None else arm_fields(arm)
    carried = {} if probe is None else {"probe": probe_text(probe)}
    run = changed(base, **named, **(options | standing | carried))
    things = {"make_map" if name == "map" else name: thing for name, thing in brought.items()}
    parts = make_parts(run, **things)
    record = recorded_config(run, brought)
    parts = replace(parts, names=parts.names | {"planner": record["planner"]})
    output = replace(output_of(run, parts, record), cannot_repeat=cannot_repeat(brought))
    return record_episode(parts, output, show_progress=show_progress)


def make_episode(
    parts: EpisodeParts, setup: Setup, *, planner: Planner | None = None, casts_rays: bool = True
) -> Episode:
    """The episode of some parts.

    Args:
        parts: What to run.
        setup: The setup of the parts' scenario and arm.
        planner: A planner that ranks as that of the parts does, to take its place.
        casts_rays: Whether readings hold points; see `Episode`.

    Raises:
        WorldError, PlannerError: Something cannot be done.
    """
    return Episode(
        setup,
        planner or parts.planner,
        seed=parts.seed,
        map_settings=parts.map_settings,
        detail=parts.detail,
        trust=parts.trust,
        tumour_map=parts.make_map,
        sensor=parts.sensor,
        motion_model=motion_model_of(setup, *parts.movement),
        sensing_s=parts.motion_settings.sensing_s,
        casts_rays=casts_rays,
        plans_for_target=parts.plans_for_target,
        body=parts.body,
    )


def record_episode(
    parts: EpisodeParts,
    output: Output,
    *,
    setup: Setup | None = None,
    show_progress: bool = True,
    notify: Notify = print_notice,
) -> dict[str, Any]:
    """Run an episode of some parts, write its folder, and return its summary.

    Args:
        parts: What to run.
        output: What to write.
        setup: The setup of the parts' scenario and arm, where the caller has it already.
        show_progress: Whether a progress bar is drawn on stderr, and notices are told.
        notify: Tells a notice; by default on stderr.

    Raises:
        UsageError, WorldError, PlannerError: Something cannot be done, and nothing was written.
        KeyboardInterrupt: Ctrl-C was pressed; what was done has been written.
    """
    start_s = perf_counter()
    check_out_folder(output.folder, overwrite=output.overwrite)
    # With one BLAS thread the bytes repeat, and the pools of NumPy and SciPy do not slow each other down.
    with threadpool_limits(limits=1), ExitStack() as stack:
        setup = setup or build_setup(parts.scenario, parts.arm, parts.map_settings, probe=parts.probe)
        episode = make_episode(parts, setup)
        show = stack.enter_context(shown(episode, output.live))
        renderer = None
        if output.frames != "none":
            renderer = stack.enter_context(frame_renderer(episode))
        folder = stack.enter_context(RunFolder(output.folder, overwrite=output.overwrite))
        notices = list(dict.fromkeys((*setup.notices, *episode.notices)))
        config = run_config(parts, setup, output.options, output.cannot_repeat) | {"notices": notices}
        folder.begin(config, {"seed": parts.seed})
        write_anatomy(folder, episode.truth)
        write_probe(folder, parts.probe)
        for notice in notices if show_progress else ():
            notify(notice)
        run = _EpisodeRun(parts, output, folder, episode, EpisodeFrames(folder.path, episode, renderer), show)
        interrupt = stack.enter_context(NotedInterrupt())
        return run.run(interrupt, start_s, show_progress=show_progress)


class _EpisodeRun:
    """An episode that is written as it goes, with its folder closed whatever ends it."""

    def __init__(
        self,
        parts: EpisodeParts,
        output: Output,
        folder: RunFolder,
        episode: Episode,
        frames: EpisodeFrames,
        show: Callable[[Step], None],
    ) -> None:
        self._parts, self._output, self._folder = parts, output, folder
        self._episode, self._frames, self._show = episode, frames, show
        self._totals, self._status = Totals(), "failed"
        self._has_told_of_reach = False

    def run(self, interrupt: NotedInterrupt, start_s: float, *, show_progress: bool) -> dict[str, Any]:
        """Sense until the end, and return the summary; the time from `start_s` to now was that of the setup."""
        setup_s = perf_counter() - start_s
        try:
            self._sense(interrupt, show_progress=show_progress)
            self._status = "finished"
        except KeyboardInterrupt:
            self._status = "interrupted"
            raise
        except ProcedureStoppedError as error:
            self._status = "stopped"
            write_motion(self._folder, len(self._totals.steps) + 1, error.motion)
            raise
        finally:
            summary = self._finish_or_fail(setup_s, start_s)
        return summary

    def _finish_or_fail(self, setup_s: float, start_s: float) -> dict[str, Any]:
        """Write what remains to be written; where that fails, for example in a user's own map, the run has failed."""
        had_failed = self._status == "failed"
        try:
            return self._finish(setup_s, start_s)
        except BaseException:
            self._folder.finish("failed")
            if had_failed:
                # The error that ended the episode is on its way, and tells more than what followed from it.
                return {}
            raise

    def _sense(self, interrupt: NotedInterrupt, *, show_progress: bool) -> None:
        parts, draws_each = self._parts, self._output.frames == "each"
        with tqdm(
            total=parts.n_steps, desc="sensing", unit="action", mininterval=0.5, disable=not show_progress
        ) as progress:
            on_skipped = partial(self._tell_skipped, progress, interrupt)
            for step in self._episode.steps(parts.n_steps, **parts.stops, on_skipped=on_skipped):
                self._totals.add(step)
                write_step(self._folder, self._episode, step)
                write_sweep(self._folder, step.step, step.reading.images, self._output.keep_images)
                self._show(step)
                if draws_each:
                    self._frames.draw(f"{step.step:04d}.png", self._totals.steps)
                progress.set_postfix_str(progress_text(step, self._episode), refresh=False)
                progress.update()
                if interrupt.is_set:
                    raise KeyboardInterrupt

    def _tell_skipped(self, progress: tqdm[NoReturn], interrupt: NotedInterrupt, n_in_a_row: int) -> None:
        """Tell how the search for a pose within reach goes, which is long where there is hardly any."""
        if interrupt.is_set:
            raise KeyboardInterrupt
        if n_in_a_row < MANY_SKIPPED:
            return
        progress.set_postfix_str(f"{n_in_a_row} poses in a row out of reach")
        if not (self._has_told_of_reach or progress.disable):
            progress.write(SKIPPED_NOTE, file=sys.stderr)
        self._has_told_of_reach = True

    def _finish(self, setup_s: float, start_s: float) -> dict[str, Any]:
        """Write the last frame, the final map, the figures, the findings, the summary and the report."""
        # Imported here, since it takes half a second, and the workers of trials write no folder.
        from sim.findings.measures import lesion_measures
        from sim.findings.results import write_results
        from sim.pictures.run_figures import draw_run_figures
        from sim.record.run_record import load_run

        folder, episode, totals, parts = self._folder, self._episode, self._totals, self._parts
        if self._output.frames == "last" and totals.steps:
            self._frames.draw("final.png", totals.steps)
        self._frames.close()
        summary = episode_summary(episode, totals, episode.metrics(), parts)
        summary |= {
            "folder": str(folder.path),
            "status": self._status,
            "ended_by": episode.ended_by,
            "confidence": summary["confidence"] if episode.planner.tells_confidence else None,
            "setup_s": setup_s,
            "render_s": self._frames.draw_s,
            "wall_s": perf_counter() - start_s,
        }
        write_map(folder, episode, is_final=True)
        for row in distance_rows(episode, parts.map_settings.prior_prevalence):
            folder.append_row("structures.csv", row)
        if totals.steps:
            draw_run_figures(folder.path, episode, totals.steps)
        findings = write_results(dataclasses.replace(load_run(folder.path), summary=summary))
        summary |= lesion_measures(findings)
        folder.write_json("summary.json", summary)
        self._publish(findings)
        return summary

    def _publish(self, findings: Findings) -> None:
        """Write the report, which is made of the finished folder."""
        from sim.report import write_report

        self._folder.finish(self._status)
        if self._output.report:
            write_report(self._folder.path, findings)
        write_own_maps(self._folder, self._episode)  # last: it is the user's code, and may raise

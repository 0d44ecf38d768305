"""The `sounding` command."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import tyro

from planner import PlannerError
from sim.errors import UsageError
from sim.running.options import EpisodeOptions
from sim.world.errors import WorldError
from sim.world.scene.gl import adopt_mujoco_gl

from .arm_options import IkOptions, ReachOptions
from .patient_options import ExportOptions, InspectOptions
from .replay_options import ReplayOptions
from .report_options import ReportOptions
from .trials_options import CompareOptions, TrialsOptions
from .view_options import ViewOptions

EXIT_NOT_REACHED, EXIT_NOT_USABLE, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 1, 1, 2, 130


@dataclass(frozen=True)
class DoctorOptions:
    """Say what is installed, which OpenGL works and how fast it draws, and what to do about each red line."""


COMMANDS = {
    "episode": EpisodeOptions,
    "trials": TrialsOptions,
    "compare": CompareOptions,
    "reach": ReachOptions,
    "ik": IkOptions,
    "replay": ReplayOptions,
    "report": ReportOptions,
    "view": ViewOptions,
    "inspect": InspectOptions,
    "export": ExportOptions,
    "doctor": DoctorOptions,
}
DESCRIPTION = (
    "Sounding plans where a robot arm presses an ultrasound-like probe on an organ, so that hidden tumours are "
    "mapped in few sensing actions."
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 2 bad input (one line says what), 130 interrupted."""
    adopt_mujoco_gl()  # before anything imports mujoco
    try:
        options = _parse(sys.argv[1:] if arguments is None else list(arguments))
        if isinstance(options, DoctorOptions):
            from sim.doctor.diagnosis import run_doctor

            return 0 if run_doctor().is_healthy else 1
        if isinstance(options, ReachOptions):
            return _reach(options)
        if isinstance(options, IkOptions):
            return _ik(options)
        if isinstance(options, ReplayOptions):
            return _replay(options)
        if isinstance(options, ReportOptions):
            return _report(options)
        if isinstance(options, ViewOptions):
            return _view(options)
        if isinstance(options, InspectOptions):
            return _inspect(options)
        if isinstance(options, ExportOptions):
            return _export(options)
        if isinstance(options, TrialsOptions):
            return _trials(options)
        if isinstance(options, CompareOptions):
            return _compare(options)
        return _episode(options)
    except (UsageError, WorldError, PlannerError) as error:
        print(f"sounding: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except OSError as error:
        print(
            f"sounding: {error.filename or 'file'}: {error.strerror}. What was written so far is kept.",
            file=sys.stderr,
        )
        return EXIT_BAD_INPUT


def _parse(arguments: list[str]) -> Any:
    return tyro.extras.subcommand_cli_from_dict(
        COMMANDS, prog="sounding", description=DESCRIPTION, args=arguments, sort_subcommands=False
    )


def _episode(options: EpisodeOptions) -> int:
    from sim.running.run import run_episode  # imports MuJoCo: a second that --help need not wait for

    from .terminal_tables import episode_table

    try:
        summary = run_episode(options)
    except KeyboardInterrupt:
        print(
            "sounding: interrupted; the run folder holds what was done, marked unfinished.", file=sys.stderr
        )
        return EXIT_INTERRUPTED
    print(episode_table(summary))
    if options.report:
        print(f"open {summary['folder']}/report.html in a browser")
    return 0


def _trials(options: TrialsOptions) -> int:
    from sim.campaign.campaign import campaign_text, run_trials
    from sim.campaign.forecast import forecast_study, forecast_text

    try:
        if options.dry_run:
            study = options.make_study()
            print(forecast_text(study, forecast_study(study, n_jobs=options.jobs), options))
            return 0
        summary = run_trials(options)
    except KeyboardInterrupt:
        print("sounding: interrupted; finished trials are kept, call again to go on.", file=sys.stderr)
        return EXIT_INTERRUPTED
    print(campaign_text(summary))
    return EXIT_INTERRUPTED if summary.is_interrupted else 0


def _compare(options: CompareOptions) -> int:
    from sim.comparison.compare import run_compare

    summary = run_compare(options)
    print(summary.text)
    print(f"written to {summary.folder}, with {len(summary.figures)} figures")
    return 0


def _reach(options: ReachOptions) -> int:
    from sim.reach.arm_comparison import run_comparison
    from sim.reach.study import run_reach

    from .terminal_tables import comparison_table, reach_table

    is_one = len(options.arm) == 1
    try:
        summary = run_reach(options) if is_one else run_comparison(options)
    except KeyboardInterrupt:
        print(
            "sounding: interrupted; a study writes its table at the end, so the folder is marked unfinished.",
            file=sys.stderr,
        )
        return EXIT_INTERRUPTED
    print(reach_table(summary) if is_one else comparison_table(summary))
    return 0


def _replay(options: ReplayOptions) -> int:
    from sim.viewing.replay import run_replay

    try:
        print(run_replay(options))
    except KeyboardInterrupt:
        print("sounding: interrupted; no video was written.", file=sys.stderr)
        return EXIT_INTERRUPTED
    return 0


def _report(options: ReportOptions) -> int:
    from sim.report import write_report

    for folder in options.folders:
        print(f"written to {write_report(folder)}")
    return 0


def _view(options: ViewOptions) -> int:
    from sim.viewing.viewer import run_view

    try:
        print(run_view(options))
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    return 0


def _inspect(options: InspectOptions) -> int:
    from sim.viewing.inspection import run_inspect

    inspection = run_inspect(options)
    print(inspection.text)
    return 0 if inspection.is_usable else EXIT_NOT_USABLE


def _export(options: ExportOptions) -> int:
    from sim.viewing.export import run_export

    print(run_export(options))
    return 0


def _ik(options: IkOptions) -> int:
    from sim.reach.explanation import explain_pose

    explanation = explain_pose(options)
    print(explanation.text)
    return 0 if explanation.is_reached else EXIT_NOT_REACHED


if __name__ == "__main__":
    sys.exit(main())

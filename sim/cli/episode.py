"""`sounding episode`: run one episode and write its folder."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from sim.running.config import EpisodeConfig
from sim.running.fields import read_config

from .exit_codes import INTERRUPTED
from .flags import given_word, note, parse
from .terminal_tables import episode_table

Options = EpisodeConfig


def parse_options(arguments: Sequence[str], prog: str) -> EpisodeConfig:
    """The options given; where `--config` names an earlier run's, those that are not given are that run's.

    Raises:
        UsageError: That file cannot be used.
    """
    # Read first: options on the line need not go together without those of the file.
    path = given_word(arguments, "config")
    default = None if path is None else read_config(Path(path))
    return parse(EpisodeConfig, arguments, prog=prog, default=default)


def run(options: EpisodeConfig) -> int:
    """Run the episode and print its results; returns the exit code."""
    from sim.running.config_file import (
        recorded_config,  # imports MuJoCo: a second that --help need not wait for
    )
    from sim.running.parts import make_parts
    from sim.running.run_episode import output_of, record_episode

    parts = make_parts(options)
    try:
        summary = record_episode(parts, output_of(options, parts, recorded_config(options)), notify=note)
    except KeyboardInterrupt:
        print(
            "sounding: interrupted; the run folder holds what was done, marked unfinished.", file=sys.stderr
        )
        return INTERRUPTED
    print(episode_table(summary))
    if options.output.report:
        print(f"open {summary['folder']}/report.html in a browser")
    return 0

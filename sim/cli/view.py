"""`sounding view`: a run in MuJoCo's viewer, or as a recording for Rerun or Foxglove."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sim.errors import FieldError

from .terminal import INTERRUPTED, parse

EXAMPLES = """
sounding view renders/first                               # needs a display
sounding view renders/first --rerun first.rrd             # needs none
sounding view renders/first --mcap first.mcap             # nor does this, for Foxglove
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Open a run in MuJoCo's viewer and play its recorded motion, or log it for Rerun or Foxglove.

    The viewer needs a display; --rerun and --mcap need none.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of a run of `sounding episode`."""
    speed: float = 1.0
    """How many times faster than the run the viewer plays, from 0.01 to 1000."""
    rerun: Path | None = None
    """Rerun recording to write (.rrd) in place of opening the viewer, which needs the extra rerun (see
    `sounding doctor`); the command rerun opens it."""

    mcap: Path | None = None
    """MCAP recording to write (.mcap) in place of opening the viewer, with messages of ROS 2 for Foxglove (extra
    mcap)."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 0.01 <= self.speed <= 1000.0:
            raise FieldError("speed", self.speed, "must be from 0.01 to 1000.")
        if self.rerun is not None and self.rerun.suffix != ".rrd":
            raise FieldError("rerun", self.rerun, "must end with .rrd.")
        if self.mcap is not None and self.mcap.suffix != ".mcap":
            raise FieldError("mcap", self.mcap, "must end with .mcap.")
        if self.mcap is not None and self.rerun is not None:
            raise FieldError("mcap", self.mcap, "is written by a call of its own, without `rerun`.")


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Show the run until the window is closed, or log it, and return the exit code."""
    from sim.record.recording import read_recording
    from sim.record.run_record import load_run
    from sim.viewing.mcap_log import write_mcap
    from sim.viewing.rerun_log import write_rerun
    from sim.viewing.viewer import check_display, play

    if options.rerun is not None:
        n_actions = write_rerun(load_run(options.folder), read_recording(options.folder), options.rerun)
        print(f"wrote {n_actions} actions to {options.rerun}; rerun {options.rerun} shows them")
        return 0
    if options.mcap is not None:
        n_actions = write_mcap(load_run(options.folder), read_recording(options.folder), options.mcap)
        print(f"wrote {n_actions} actions to {options.mcap}; Foxglove opens it")
        return 0
    recording = read_recording(options.folder)
    check_display()
    try:
        play(recording, options.speed)
    except KeyboardInterrupt:
        return INTERRUPTED
    print("closed")
    return 0

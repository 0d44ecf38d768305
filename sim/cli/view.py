"""`sounding view`: a run in MuJoCo's viewer, or as a recording for Rerun, Foxglove or a renderer of USD."""

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
sounding view renders/first --usd first.usdc              # or this, for Blender and Omniverse
"""
"""What the help begins with."""
USD_SUFFIXES = (".usdc", ".usda", ".usd", ".usdz")


@dataclass(frozen=True, kw_only=True)
class Options:
    """Open a run in MuJoCo's viewer and play its recorded motion, or write it for Rerun, Foxglove or a renderer.

    The viewer needs a display; --rerun, --mcap and --usd need none.
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
    usd: Path | None = None
    """USD stage to write (.usdc, .usda, .usd or .usdz) in place of opening the viewer, with the motion of the arm and
    the map as it grew, for Blender, Omniverse and other renderers (extra usd)."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 0.01 <= self.speed <= 1000.0:
            raise FieldError("speed", self.speed, "must be from 0.01 to 1000.")
        if self.rerun is not None and self.rerun.suffix != ".rrd":
            raise FieldError("rerun", self.rerun, "must end with .rrd.")
        if self.mcap is not None and self.mcap.suffix != ".mcap":
            raise FieldError("mcap", self.mcap, "must end with .mcap.")
        if self.usd is not None and self.usd.suffix not in USD_SUFFIXES:
            raise FieldError("usd", self.usd, "must end with .usdc, .usda, .usd or .usdz.")
        written = [name for name in ("rerun", "mcap", "usd") if getattr(self, name) is not None]
        if len(written) > 1:
            other, name = written[:2]
            raise FieldError(
                name, getattr(self, name), f"is written by a call of its own, without `{other}`."
            )


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Show the run until the window is closed, or log it, and return the exit code."""
    from sim.record.recording import read_recording
    from sim.record.run_record import load_run
    from sim.viewing.mcap_log import write_mcap
    from sim.viewing.rerun_log import write_rerun
    from sim.viewing.usd.run_stage import write_usd
    from sim.viewing.viewer import check_display, play

    if options.rerun is not None:
        n_actions = write_rerun(load_run(options.folder), read_recording(options.folder), options.rerun)
        print(f"wrote {n_actions} actions to {options.rerun}; rerun {options.rerun} shows them")
        return 0
    if options.mcap is not None:
        n_actions = write_mcap(load_run(options.folder), read_recording(options.folder), options.mcap)
        print(f"wrote {n_actions} actions to {options.mcap}; Foxglove opens it")
        return 0
    if options.usd is not None:
        n_actions = write_usd(load_run(options.folder), read_recording(options.folder), options.usd)
        print(f"wrote {n_actions} actions to {options.usd}; Blender, usdview and Omniverse open it")
        return 0
    recording = read_recording(options.folder)
    check_display()
    try:
        play(recording, options.speed)
    except KeyboardInterrupt:
        return INTERRUPTED
    print("closed")
    return 0

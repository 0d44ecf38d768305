"""What can be asked of a view."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sim.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """Open a run in MuJoCo's viewer and play its recorded motion, or log it as a Rerun recording.

    The viewer needs a display; --rerun needs none.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder of a run of `sounding episode`."""
    speed: float = 1.0
    """How many times faster than it happened the viewer plays."""
    rerun: Path | None = None
    """Write a Rerun recording (.rrd) here, with its timelines, in place of opening the viewer. Needs
    pip install 'sounding[rerun]'; `rerun FILE` opens it."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 0.01 <= self.speed <= 1000.0:
            raise UsageError(f"--speed {self.speed}: from 0.01 to 1000.")
        if self.rerun is not None and self.rerun.suffix != ".rrd":
            raise UsageError(f"--rerun {self.rerun}: must end with .rrd.")

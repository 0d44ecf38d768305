"""What can be asked of a report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sim.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """Write report.html anew from the files of a run, finished or not.

    The page holds everything it shows and opens without a network.
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER ...")]
    """Folders of runs of `sounding episode`."""

    def __post_init__(self) -> None:
        """Ask for one folder at least."""
        if not self.folders:
            raise UsageError(
                "report: name the folder of a run, for example renders/liver-find-and-outline-0."
            )

"""`sounding report`: the page of a run, written anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sim.errors import UsageError

from .terminal import parse

EXAMPLES = """
sounding report renders/first
sounding report renders/first renders/second
sounding report renders/first --bound renders/bound-sphere   # beside the least possible
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Write report.html anew from the files of a run, finished or not.

    The page holds everything that it shows, and opens without a network.
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER ...")]
    """Folders of runs of `sounding episode`."""
    bound: tuple[Path, ...] = ()
    """Folders that `sounding bound` wrote; the page and summary.json then tell how the actions until 95 % of the
    tumours was sensed compare with the least possible for the run's seed."""

    def __post_init__(self) -> None:
        """Check that there is a folder."""
        if not self.folders:
            raise UsageError(
                "report: name the folder of a run, for example renders/liver-find-and-outline-0."
            )


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Write the reports, and return the exit code."""
    from sim.report import write_report

    if options.bound:
        from sim.bound.limit import keep_limit

        for folder in options.folders:
            keep_limit(folder, options.bound)
    for folder in options.folders:
        print(f"written to {write_report(folder)}")
    return 0

"""`sounding compare`: tables, intervals and figures of one or more campaigns."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sim.campaign.study import parse_seeds
from sim.errors import FieldError, UsageError

from .terminal import parse


@dataclass(frozen=True, kw_only=True)
class Options:
    """Compare the planners of one or more campaigns, on equal seeds: tables, intervals and figures.

    Writes compare.md, compare.csv and figures, and prints the tables.
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders that `sounding trials` wrote."""
    out: Path | None = None
    """Folder to write to; <first folder>/compare by default."""
    seeds: str | None = None
    """Look at these seeds only, for example 0:10, whose end is left out."""
    reference: str | None = None
    """Contender against which all others are paired; by default all pairs are."""
    view_seed: int | None = None
    """Run this seed of each contender again and draw its map and poses from above and from the side."""
    jobs: int = 2
    """Processes that draw the views."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not self.folders:
            raise UsageError("compare needs one folder or more that `sounding trials` wrote.")
        if not 1 <= self.jobs <= 256:
            raise FieldError("jobs", self.jobs, "from 1 to 256.")

    def seed_range(self) -> Container[int] | None:
        """The seeds to look at, None for all."""
        return None if self.seeds is None else parse_seeds(self.seeds)


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options given."""
    return parse(Options, arguments, prog=prog)


def run(options: Options) -> int:
    """Compare the campaigns and print the tables; returns the exit code."""
    from sim.comparison.compare import compare

    summary = compare(
        options.folders,
        options.out,
        seeds=options.seed_range(),
        reference=options.reference,
        view_seed=options.view_seed,
        jobs=options.jobs,
    )
    print(summary.text)
    print(f"written to {summary.folder}, with {len(summary.figures)} figures")
    return 0

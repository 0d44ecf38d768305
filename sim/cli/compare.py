"""`sounding compare`: tables, intervals and figures of one or more campaigns, or runs on one page."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sim.campaign.study import parse_seeds
from sim.errors import FieldError, UsageError

from .terminal import parse

EXAMPLES = """
sounding compare renders/paper
sounding compare renders/one renders/another --out renders/both
sounding compare renders/paper --reference random --seeds 0:10
sounding compare renders/mine --bound renders/bound-sphere
sounding compare renders/paper --view-seed 4              # runs seed 4 of each contender again
sounding compare renders/first renders/second             # two runs of sounding episode on one page
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Compare the planners of one or more campaigns on equal seeds, with tables, intervals and figures, or show two to
    four runs of `sounding episode` on one page.

    The output folder gets compare.md, compare.csv, report.html and, for campaigns, compare_lesions.csv and figures; the
    tables are printed as well.
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders that `sounding trials` wrote, or folders of runs."""
    out: Path | None = None
    """Folder to write to; by default compare in the first of the folders, with the names of the others behind."""
    seeds: str | None = None
    """Seeds to look at, for example 0:10, which leaves 10 out; by default all."""
    reference: str | None = None
    """Contender with which all others are paired; by default all are paired with each other."""
    bound: tuple[Path, ...] = ()
    """Folders that `sounding bound` wrote, one for each case; every contender, or run, is then shown beside the least
    possible: the hindsight optimum of each seed, and what any policy takes in the mean."""
    view_seed: int | None = None
    """Run this seed of each contender again, and draw its map and poses from above and from the side, which takes as
    long as these episodes: up to a minute or so for each."""
    jobs: int = 2
    """Number of processes that draw the views."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not self.folders:
            raise UsageError(
                "compare needs one folder or more that `sounding trials` wrote, or two of `sounding episode`."
            )
        if not 1 <= self.jobs <= 256:
            raise FieldError("jobs", self.jobs, "must be from 1 to 256.")

    def seed_range(self) -> Container[int] | None:
        """The seeds to look at, None for all."""
        return None if self.seeds is None else parse_seeds(self.seeds)


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Compare the campaigns, print the tables, and return the exit code."""
    from sim.comparison.compare import compare

    summary = compare(
        options.folders,
        options.out,
        seeds=options.seed_range(),
        reference=options.reference,
        view_seed=options.view_seed,
        jobs=options.jobs,
        bound=options.bound,
    )
    print(summary.text)
    figures = f", with {len(summary.figures)} figures" if summary.figures else ""
    print(f"written to {summary.folder}{figures}")
    return 0

"""What can be asked about trials on the command line: pure data, in the units people type."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from sim.campaign.engines.engine import EngineName
from sim.campaign.study import Part, Study, option_value, parse_seeds
from sim.campaign.study_file import load_study
from sim.errors import UsageError
from sim.running.options import MapKept, MotionKind


@dataclass(frozen=True, kw_only=True)
class TrialsOptions:
    """Run many episodes: every combination of scenarios, planners, arms and seeds, or those of a study file.

    Writes trials.csv, a row per trial, timings.csv, curves.npz and a journal to the output folder. Called again, also
    after being killed, it goes on where it stopped; a study may also grow, for example by more seeds.
    """

    study: str | None = None
    """A study file (.toml), or a study that Sounding brings along, for example paper. What is given beside it takes
    precedence."""
    scenario: tuple[str, ...] = ()
    """Scenarios: sphere, spheres, liver, or paths of scenario files; liver by default."""
    planner: tuple[str, ...] = ()
    """Planners; find-and-outline by default."""
    arm: tuple[str, ...] = ()
    """Arms: default, none, or paths of MJCF files; default by default."""
    trials: int | None = None
    """Number of trials of each combination: seeds 0, 1, 2, ...; 10 where nothing says otherwise."""
    seeds: str | None = None
    """Seeds in place of --trials, for example 5000:5100, whose end is left out."""
    steps: int | None = None
    """Sensing actions at most."""
    until_sensed: float | None = None
    """Stop an episode as soon as this share of the tumours was sensed, for example 0.95."""
    motion: MotionKind | None = None
    """How the arm gets from pose to pose. By default none: it jumps, with the time of the way estimated, which is far
    faster; kinematic searches a path for it, servo simulates it."""
    map: MapKept | None = None
    """Whether planners that need no map keep one. By default they do not where --until-sensed ends the episodes: then
    only the share sensed is asked."""
    out: Path | None = None
    """Folder to write to; renders/<study>, or renders/trials."""
    jobs: int = 2
    """Processes. The rows do not depend on it."""
    engine: EngineName = "local"
    """local (processes of this machine), dask or ray."""
    address: str | None = None
    """Address of the Dask or Ray cluster; without it one is started on this machine."""
    folders: bool = False
    """Write each trial's episode folder too, under trials/; takes twice the time."""
    dry_run: bool = False
    """Print how many trials there are and about how long they take, and write nothing."""
    retry_failed: bool = False
    """Run trials again that failed or whose worker died."""
    overwrite: bool = False
    """Replace a campaign that the folder already holds."""
    any_version: bool = False
    """Go on with a campaign that another version of the code began. Its rows may differ for that alone."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 1 <= self.jobs <= 256:
            raise UsageError(f"--jobs {self.jobs}: from 1 to 256.")
        if self.trials is not None and self.trials < 1:
            raise UsageError(f"--trials {self.trials}: 1 or more.")
        if self.trials is not None and self.seeds is not None:
            raise UsageError("--trials and --seeds both say which seeds: give one of them.")

    def make_study(self) -> Study:
        """The study asked for.

        Raises:
            UsageError: A study file that cannot be used, or a value out of range.
        """
        given = self._given()
        if self.study is not None:
            return load_study(self.study, given)
        if "map" not in given and "until_sensed" in given:
            given["map"] = ("when-needed",)
        given.setdefault("motion", ("none",))
        given.setdefault("seed", range(10))
        return Study("trials", (Part(given),))

    def out_folder(self, study: Study) -> Path:
        """The folder asked for, or the one that names the study."""
        if self.out is not None:
            return self.out
        return Path("renders") / (Path(self.study).stem if self.study is not None else study.title)

    def _given(self) -> dict[str, Any]:
        """Values of the episode's options that the command line names."""
        given: dict[str, Any] = {
            name: tuple(getattr(self, name)) for name in ("scenario", "planner", "arm") if getattr(self, name)
        }
        for name in ("steps", "until_sensed", "motion", "map"):
            if getattr(self, name) is not None:
                given[name] = (option_value(name, getattr(self, name)),)
        if self.trials is not None:
            given["seed"] = range(self.trials)
        if self.seeds is not None:
            given["seed"] = parse_seeds(self.seeds)
        return given


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
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
            raise UsageError(f"--jobs {self.jobs}: from 1 to 256.")

    def seed_range(self) -> Container[int] | None:
        """The seeds to look at, None for all."""
        return None if self.seeds is None else parse_seeds(self.seeds)

    def out_folder(self) -> Path:
        """The folder asked for, or the one within the first campaign's."""
        return self.out or self.folders[0] / "compare"

"""`sounding trials`: run the episodes of a study."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.campaign.engines.factory import EngineName
from sim.campaign.study import Part, Study, parse_seeds
from sim.campaign.study_file import load_study
from sim.errors import FieldError, UsageError
from sim.running.fields import converted
from sim.world.motion.settings import MotionKind

from .terminal import INTERRUPTED, in_flags, parse

if TYPE_CHECKING:
    from sim.campaign.campaign import CampaignSummary


@dataclass(frozen=True, kw_only=True)
class Options:
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
    """Planners, also of your own as package.module:Class; find-and-outline by default."""
    sensor: tuple[str, ...] = ()
    """Sensors, also of your own as package.module:Class; cone by default."""
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
    map: str | None = None
    """always, when-needed (planners that need no map keep none), or a map of your own as package.module:Class. By
    default when-needed where --until-sensed ends the episodes, since only the share sensed counts then."""
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
            raise FieldError("jobs", self.jobs, "from 1 to 256.")
        if self.trials is not None and self.trials < 1:
            raise FieldError("trials", self.trials, "1 or more.")
        if self.trials is not None and self.seeds is not None:
            raise UsageError("`trials` and `seeds` both say which seeds: give one of them.")

    def make_study(self) -> Study:
        """The study that the options describe.

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
        """The folder that the options name, or the one that names the study."""
        if self.out is not None:
            return self.out
        return Path("renders") / (Path(self.study).stem if self.study is not None else study.title)

    def _given(self) -> dict[str, Any]:
        """Values of the episode's options that the command line names."""
        given: dict[str, Any] = {
            name: tuple(getattr(self, name))
            for name in ("scenario", "planner", "sensor", "arm")
            if getattr(self, name)
        }
        for name in ("steps", "until_sensed", "motion", "map"):
            if getattr(self, name) is not None:
                given[name] = (converted(name, getattr(self, name)),)
        if self.trials is not None:
            given["seed"] = range(self.trials)
        if self.seeds is not None:
            given["seed"] = parse_seeds(self.seeds)
        return given


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options given."""
    return parse(Options, arguments, prog=prog)


def run(options: Options) -> int:
    """Run the trials, or tell how many there are; returns the exit code."""
    from sim.campaign.campaign import campaign_text
    from sim.campaign.forecast import forecast_study, forecast_text

    study = options.make_study()
    try:
        if options.dry_run:
            forecasts = forecast_study(study, n_jobs=options.jobs)
            print(in_flags(forecast_text(study, forecasts, n_jobs=options.jobs), Options))
            return 0
        summary = run_campaign(options, study)
    except KeyboardInterrupt:
        print("sounding: interrupted; finished trials are kept, call again to go on.", file=sys.stderr)
        return INTERRUPTED
    print(in_flags(campaign_text(summary), Options))
    return INTERRUPTED if summary.is_interrupted else 0


def run_campaign(options: Options, study: Study | None = None) -> CampaignSummary:
    """Run the trials that the options describe.

    Args:
        options: What to run, and how.
        study: That of the options, where the caller has it already.
    """
    from sim.campaign.campaign import run_trials

    study = study or options.make_study()
    return run_trials(
        study,
        options.out_folder(study),
        jobs=options.jobs,
        engine=options.engine,
        address=options.address,
        folders=options.folders,
        retry_failed=options.retry_failed,
        overwrite=options.overwrite,
        any_version=options.any_version,
    )

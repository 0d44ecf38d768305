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
from sim.running.reader import LabelTrustName, ReaderName
from sim.world.motion.settings import MotionKind

from .terminal import INTERRUPTED, in_flags, note, parse

if TYPE_CHECKING:
    from sim.campaign.campaign import CampaignSummary

EXAMPLES = """
sounding trials --scenario sphere --planner random find-and-outline --arm none --trials 20
sounding trials --study paper --dry-run                   # how many trials, and how long they take
sounding trials --study paper --jobs 2                    # again after a kill: it goes on
sounding trials --study study.toml --out renders/mine
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run many episodes: every combination of scenarios, planners, arms and seeds, or those of a study file.

    The output folder gets trials.csv with a row per trial, lesions.csv with a row per lesion, timings.csv, curves.npz
    and a journal. Called again, also after a kill, the command goes on where it stopped; the study may have grown
    meanwhile, for example by more seeds.
    """

    study: str | None = None
    """Study: the path of a study file (.toml), or the name of a study that Sounding brings along, for example paper.
    Options that are given beside it take precedence."""
    scenario: tuple[str, ...] = ()
    """Scenarios: sphere, spheres, liver, or paths of scenario files (.toml); by default liver."""
    planner: tuple[str, ...] = ()
    """Planners, which may be your own as package.module:Class; by default find-and-outline."""
    sensor: tuple[str, ...] = ()
    """Sensors, which may be your own as package.module:Class; by default cone."""
    reader: tuple[ReaderName, ...] = ()
    """Readers of the sensors cone-with-errors and ultrasound: exact or published, and for ultrasound image; by default
    exact. A study may name each error."""
    label_trust: tuple[LabelTrustName, ...] = ()
    """How far labels are trusted: exact, told or learnt; by default told with the reader image, learnt with others
    that err, and exact where none errs."""
    arm: tuple[str, ...] = ()
    """Arms: default (the embedded one), none, or paths of MJCF files; by default the embedded one."""
    probe: tuple[str, ...] = ()
    """Probes: default (the embedded one), or paths of MJCF files with a site named tip; by default the embedded one."""
    trials: int | None = None
    """Number of trials of each combination, with the seeds 0, 1, 2 and so on; by default 10, or those of the study."""
    seeds: str | None = None
    """Seeds in place of `trials`, for example 5000:5100, which leaves 5100 out."""
    steps: int | None = None
    """Largest number of sensing actions of an episode."""
    until_sensed: float | None = None
    """Stop an episode as soon as this share of the tumours was sensed, for example 0.95."""
    until_confident: float | None = None
    """Stop an episode as soon as the planner is this confident that nothing is left to find or outline."""
    miss_cost: float | None = None
    """Stop an episode as soon as going on is not worth it, where a missed lesion is worth this many sensing actions."""
    motion: MotionKind | None = None
    """Motion of the probe: none (it jumps, with the time of its way estimated, which is far faster), kinematic (a path
    is searched) or servo (the path is simulated); by default none, or that of the study."""
    map: str | None = None
    """Map to keep: always (the built-in map), when-needed (the built-in map only for planners that need it), or your
    own as package.module:Class; by default that of the study, or without a study when-needed where `until_sensed` ends
    the episodes, since only the share sensed counts then, and always otherwise."""
    out: Path | None = None
    """Folder to write to; by default renders/<study>, or renders/trials without a study, with a number behind where
    that holds another study. A study that was begun goes on in its folder."""
    jobs: int = 2
    """Number of processes; the rows do not depend on it."""
    engine: EngineName = "local"
    """Where the trials run: local (processes of this machine), dask or ray."""
    address: str | None = None
    """Address of the Dask or Ray cluster; by default one is started on this machine."""
    folders: bool = False
    """Write each trial's episode folder too, under trials/, which takes twice the time."""
    dry_run: bool = False
    """Print how many trials there are and about how long they take, and write nothing."""
    retry_failed: bool = False
    """Run trials again that failed or whose worker died."""
    overwrite: bool = False
    """Replace a campaign that the folder already holds."""
    any_version: bool = False
    """Go on with a campaign that another version of the code began, for which reason its rows may differ."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 1 <= self.jobs <= 256:
            raise FieldError("jobs", self.jobs, "must be from 1 to 256.")
        if self.trials is not None and self.trials < 1:
            raise FieldError("trials", self.trials, "must be 1 or more.")
        if self.trials is not None and self.seeds is not None:
            raise UsageError("`trials` and `seeds` both say which seeds: give one of them.")

    def make_study(self) -> Study:
        """The study that the options describe.

        Raises:
            UsageError: The study file cannot be used, or a value is out of range.
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
        """The folder that the options name, or the first of the study's name that holds no other study."""
        if self.out is not None:
            return self.out
        from sim.campaign.campaign_folder import can_hold
        from sim.record.default_folders import first_path

        name = Path(self.study).stem if self.study is not None else study.title
        return first_path(name, lambda path: can_hold(path, study))

    def _given(self) -> dict[str, Any]:
        """The values of an episode's options that the command line names."""
        given: dict[str, Any] = {
            name: tuple(getattr(self, name))
            for name in ("scenario", "planner", "sensor", "reader", "label_trust", "arm", "probe")
            if getattr(self, name)
        }
        for name in ("steps", "until_sensed", "until_confident", "miss_cost", "motion", "map"):
            if getattr(self, name) is not None:
                given[name] = (converted(name, getattr(self, name)),)
        if self.trials is not None:
            given["seed"] = range(self.trials)
        if self.seeds is not None:
            given["seed"] = parse_seeds(self.seeds)
        return given


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Run the trials, or tell how many there are, and return the exit code."""
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
    """Run the trials that the options describe, and return what was done.

    Args:
        options: What to run, and how.
        study: The study that the options describe, where the caller has it already.
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
        notify=note,
    )

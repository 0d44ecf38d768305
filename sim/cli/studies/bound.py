"""`sounding bound`: how few actions any planner can need, with a certificate, and the check of one."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from sim.campaign.study import parse_seeds
from sim.cli.terminal import INTERRUPTED, NOT_USABLE, note, parse
from sim.errors import FieldError
from sim.running.case import AnatomyConfig, CaseConfig
from sim.running.config import EpisodeConfig
from sim.running.fields import episode_of
from sim.running.parts import check_config

if TYPE_CHECKING:
    from sim.bound.study import BoundSettings

EXAMPLES = """
sounding bound --scenario sphere --seeds 0:100
sounding bound --scenario liver --arm default --seeds 0:20
sounding bound --check renders/bound-sphere               # proves what was found anew
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Find how few sensing actions any planner can need for 95 % of the tumours, and write a certificate of it.

    For each seed it is the hindsight optimum: the fewest poses that are enough for a planner that knows the truth. For
    a scenario that plants its tumours in one organ it is also the least mean number of actions of any policy that does
    not, adaptive or drawn by lot. The output folder gets bound.json and seeds.csv, and what proves them: poses.npz,
    policy.npz, a file for each seed and for every 50 places. Called again, also after a kill, the command goes on where
    it stopped.
    """

    check: Path | None = None
    """Check the certificate in this folder in place of finding a bound; of the other options only `jobs` counts."""
    scenario: str = "sphere"
    """Scenario: sphere or spheres (the paper's synthetic organ with 1 or 3 tumours), liver, generated-liver, or the
    path of a scenario file (.toml)."""
    arm: str = "none"
    """Arm that carries the probe, whose reached poses alone count: none (a free-flying probe), default (the embedded
    one), ur5e (with the extra `arms`), or the path of an MJCF file."""
    seeds: str = "0:20"
    """Seeds whose hindsight optimum is found, for example 0:100, which leaves 100 out."""
    places: int = 1000
    """Places of a tumour that are drawn anew for the bound on every policy, from 10 to 100000, or 0 for none. More of
    them make it tighter."""
    organ: Path | None = None
    """Mesh or label volume that replaces the scenario's organ."""
    jobs: int = 2
    """Number of processes; what is found does not depend on it."""
    out: Path | None = None
    """Folder to write to; by default renders/bound-<scenario>, with the arm where there is one, and with a number
    behind where that holds something else."""
    overwrite: bool = False
    """Replace a bound that the folder already holds."""
    case: CaseConfig = field(default_factory=CaseConfig)
    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 1 <= self.jobs <= 256:
            raise FieldError("jobs", self.jobs, "must be from 1 to 256.")
        if self.places != 0 and not 10 <= self.places <= 100_000:
            raise FieldError("places", self.places, "must be from 10 to 100000, or 0.")
        parse_seeds(self.seeds)
        self.make_config()

    def make_config(self) -> EpisodeConfig:
        """Scenario, arm and case as the configuration of an episode."""
        return episode_of(self)

    def make_settings(self) -> BoundSettings:
        """What is bounded, and how."""
        from sim.bound.study import BoundSettings

        return BoundSettings(
            seeds=tuple(parse_seeds(self.seeds)),
            n_places=self.places,
            n_jobs=self.jobs,
            overwrite=self.overwrite,
        )

    def out_folder(self, settings: BoundSettings) -> Path:
        """The folder that the options name, or the first of the scenario's name that can hold this bound."""
        if self.out is not None:
            return self.out
        from sim.bound.folder import can_hold
        from sim.bound.study import question_of
        from sim.record.default_folders import file_part, first_path

        question = question_of(self.make_config(), settings)
        named = self.scenario if self.organ is None else self.organ.name
        parts = ["bound", file_part(named), *([] if self.arm == "none" else [file_part(self.arm)])]
        return first_path("-".join(parts), lambda path: self.overwrite or can_hold(path, question))


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Find a bound or check one, print what is to be told, and return the exit code."""
    try:
        return _find(options) if options.check is None else _check(options.check, options.jobs)
    except KeyboardInterrupt:
        kept = "" if options.check is not None else "; what was found is kept, call again to go on"
        print(f"sounding: interrupted{kept}.", file=sys.stderr)
        return INTERRUPTED


def _find(options: Options) -> int:
    from sim.bound.study import bound_study
    from sim.bound.summary import bound_text

    config, settings = options.make_config(), options.make_settings()
    check_config(config)
    content = bound_study(config, options.out_folder(settings), settings, notify=note)
    print(bound_text(content))
    print(f"written to {content['folder']}")
    return 0


def _check(path: Path, n_jobs: int) -> int:
    from sim.bound.check.checking import check_bound
    from sim.bound.check.proof import DoesNotHoldError

    try:
        told = check_bound(path, n_jobs=n_jobs)
    except DoesNotHoldError as error:
        print(f"{path}: does not hold. {error}.")
        return NOT_USABLE
    print("\n".join(f"verified: {each}" for each in told))
    return 0

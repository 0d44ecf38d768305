"""`sounding dataset`: episodes for others to train on, in shards."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from sim.cli.terminal import INTERRUPTED, parse
from sim.errors import FieldError
from sim.record.default_folders import file_part
from sim.running.case import AnatomyConfig, CaseConfig
from sim.running.config import (
    CONE,
    ExpectedImprovementConfig,
    FindAndOutlineConfig,
    MappingConfig,
    MovingConfig,
    PlanningConfig,
    SensingConfig,
)
from sim.running.fields import episode_of
from sim.running.reader import ReaderConfig
from sim.running.ultrasound import UltrasoundConfig
from sim.world.motion.settings import MotionKind

EXAMPLES = """
sounding dataset --scenario generated-liver --seeds 0:1000 --out renders/livers
sounding dataset --scenario generated-liver --seeds 0:2000 --out renders/livers     # goes on with more seeds
sounding dataset --sensor ultrasound --arm none --seeds 0:100 --format lerobot
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run many episodes and keep what was sensed, believed and true of each action, for others to train on.

    The folder gets shards, dataset.json and README.md, a card that tells every field. A shard is written whole: called
    again, also after a kill or with more seeds, the command goes on with those that are missing.
    """

    scenario: str = "generated-liver"
    """Scenario: sphere, spheres, liver, generated-liver (an organ for each seed), or the path of a file (.toml)."""
    organ: Path | None = None
    """Mesh or label volume that replaces the scenario's organ."""
    seeds: str = "0:100"
    """Seeds of the episodes, for example 0:10000, which leaves 10000 out."""
    format: Literal["parquet", "hdf5", "lerobot"] = "parquet"
    """Files to write: parquet (extra `parquet`), hdf5 (extra `hdf5`), or lerobot (a LeRobotDataset, beside shards in
    Parquet)."""
    shard: int = 50
    """Episodes of a shard."""
    planner: str = "find-and-outline"
    """What chooses the poses, as in `sounding episode`."""
    sensor: str = CONE
    """What senses, as in `sounding episode`; ultrasound adds pictures."""
    steps: int = 30
    """Largest number of sensing actions of an episode."""
    until_sensed: float | None = None
    """Stop an episode as soon as this share of the tumours was sensed, for example 0.95."""
    until_confident: float | None = None
    """Stop an episode as soon as the planner is this confident that nothing is left to find or outline."""
    arm: str = "default"
    """Arm that carries the probe, as in `sounding episode`; none is a free-flying probe, which is faster."""
    motion: MotionKind = "none"
    """Motion of the probe: none (it jumps), kinematic (a path is searched) or servo (the path is simulated)."""
    jobs: int = 2
    """Number of processes; the episodes do not depend on it."""
    out: Path | None = None
    """Folder to write to; by default renders/dataset-<scenario>-<format>. What it holds already is gone on with."""
    case: CaseConfig = field(default_factory=CaseConfig)
    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    reading: ReaderConfig = field(default_factory=ReaderConfig)
    ultrasound: UltrasoundConfig = field(default_factory=UltrasoundConfig)
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    find_and_outline: FindAndOutlineConfig = field(default_factory=FindAndOutlineConfig)
    expected_improvement: ExpectedImprovementConfig = field(default_factory=ExpectedImprovementConfig)
    mapping: MappingConfig = field(default_factory=MappingConfig)

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 1 <= self.jobs <= 256:
            raise FieldError("jobs", self.jobs, "must be from 1 to 256.")
        if not 1 <= self.shard <= 10_000:
            raise FieldError("shard", self.shard, "must be from 1 to 10000.")


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Build the dataset, and return the exit code."""
    from sim.campaign.study import parse_seeds
    from sim.dataset.building import build
    from sim.dataset.plan import DatasetPlan

    default = Path("renders") / f"dataset-{file_part(options.scenario)}-{options.format}"
    plan = DatasetPlan(
        config=episode_of(options, moving=MovingConfig(motion=options.motion)),
        seeds=parse_seeds(options.seeds),
        format=options.format,
        shard_size=options.shard,
        folder=options.out or default,
    )
    try:
        n_run = build(plan, n_jobs=options.jobs, tell=lambda text: print(text, flush=True))
    except KeyboardInterrupt:
        print(f"sounding: ended; whole shards are kept in {plan.folder}.", file=sys.stderr)
        return INTERRUPTED
    print(f"{len(plan.seeds)} episodes, {n_run} of them run now, in {plan.folder}")
    return 0

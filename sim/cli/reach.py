"""`sounding reach`: which sensing poses of a scenario an arm reaches, or several arms."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from sim.episode.scenario import Scenario
from sim.episode.scenario_file import load_scenario
from sim.errors import FieldError, UsageError
from sim.record.default_folders import default_folder, file_part
from sim.running.case import MM, AnatomyConfig, CaseConfig, scenario_changes
from sim.running.config import EpisodeConfig
from sim.running.placing.arm_place import arm_standing, check_base, check_padding
from sim.running.settings import in_fields

from .terminal import INTERRUPTED, aligned_lines, note, parse

if TYPE_CHECKING:
    from sim.reach.study import StudySettings
    from sim.world.scene.arm import ArmModel

Triple = tuple[float, float, float]
REACH_ROWS = (
    ("poses", "n_poses", "{}"),
    ("reached", "reached_fraction", "{:.2%}"),
    ("share in the largest connected region", "largest_region_fraction", "{:.2%}"),
    ("connected regions", "n_regions", "{}"),
    ("score, median", "score_median", "{:.2f}"),
    ("clearance, tenth percentile [m]", "clearance_m_p10", "{:.3f}"),
    ("distance to joint limits, tenth percentile [rad]", "joint_limit_distance_rad_p10", "{:.2f}"),
    ("poses a second", "poses_per_s", "{:.0f}"),
    ("time in all [s]", "wall_s", "{:.1f}"),
)

EXAMPLES = """
sounding reach                                            # the embedded arm and the embedded liver
sounding reach --organ liver.nii.gz --tilt-deg 15         # with the probe off the normal
sounding reach --base-search 200                          # where should the base stand?
sounding reach --arm default ur5e                         # two arms in one table
sounding reach --arm my_arm.xml --flange hand --base-mm 0 -100 0
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Say which sensing poses of a scenario an arm reaches, how well, and why it does not reach the others.

    The output folder gets reach.csv, summary.json, config.json, manifest.json, reach.png (the organ coloured by score)
    and reasons.png; with --base-search also bases.csv and bases.png (where the base could stand). Several arms are
    compared on one workspace: each has its own folder in the output folder, beside arms.csv, arms.md and arms.png.
    """

    scenario: str = "liver"
    """Scenario: sphere or spheres (the paper's synthetic organ), liver, or the path of a scenario file (.toml)."""
    arm: tuple[str, ...] = ("default",)
    """Arm: default (the embedded one with 7 joints), ur5e (with the extra `arms`), or the path of an MJCF file; several
    arms are compared."""
    flange: tuple[str, ...] = ()
    """Site or body of the arm that carries the probe, +z out of it, one for all arms or one for each; by default the
    site flange or attachment_site, or the body tool0 or flange."""
    probe: str = "default"
    """Probe of every arm: default (the embedded one, straight and 160 mm long), or the path of an MJCF file that has a
    site named tip."""
    base_mm: Triple = (0.0, 0.0, 0.0)
    """Where the arm's base stands in the world [mm]; the table's top is z = 0."""
    base_yaw_deg: float = 0.0
    """Angle by which the base is turned about the vertical [degrees]."""
    base_search: int = 0
    """Search also where the base should stand, with this many candidate bases: from 10 to 5000, or 0 for no search."""
    base_poses: int = 500
    """Number of poses of the workspace, drawn by seed, that each candidate base is tried on."""
    base_height_mm: tuple[float, float] = (0.0, 300.0)
    """Lowest and highest candidate base above the table's top [mm]."""
    base_objective: Literal["poses", "seen"] = "poses"
    """What makes a base good: the share of the poses that it reaches (poses), or the share of the organ's inside that
    the probe's cone sees from these (seen)."""
    organ: Path | None = None
    """Mesh or label volume that replaces the scenario's organ."""
    tilt_deg: float = 0.0
    """Try poses that are not reached again with the probe tilted off the normal by up to this [degrees]."""
    standoff_mm: float = 40.0
    """Distance above each pose from which the probe approaches it [mm], where the arm has to be free too; with 0 only
    the poses are solved."""
    padding_mm: float = 0.0
    """Room that arm and probe keep from the table, and the arm from itself and beyond its 3 mm from the organ [mm]:
    at most 30. With it, distances are true ones, which takes longer."""
    restarts: int = 40
    """Number of starts after the first before a pose is called unreachable, from 0 to 119."""
    seed: int = 0
    """Seed of the set of starts, and of the search for a base. Another one changes which of several answers is found,
    and so the scores of some poses, but hardly which poses are reached."""
    jobs: int = 2
    """Number of processes that share the poses; the answers do not depend on it."""
    out: Path | None = None
    """Folder to write to; by default renders/reach-<scenario>-<arm>, without the arm where it is the embedded one, and
    with a number behind where that is taken."""
    overwrite: bool = False
    """Replace a run that the folder already holds."""
    parquet: bool = False
    """Write reach.parquet beside reach.csv, which needs the extra parquet (`sounding doctor` says how to get it)."""
    case: CaseConfig = field(default_factory=CaseConfig)
    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 0.0 <= self.tilt_deg <= 80.0:
            raise FieldError("tilt_deg", self.tilt_deg, "must be from 0 to 80 degrees.")
        if not 0.0 <= self.standoff_mm <= 500.0:
            raise FieldError("standoff_mm", self.standoff_mm, "must be from 0 to 500 mm.")
        check_padding(self.padding_mm)
        if not 0 <= self.restarts <= 119:
            raise FieldError("restarts", self.restarts, "must be from 0 to 119.")
        if not 1 <= self.jobs <= 64:
            raise FieldError("jobs", self.jobs, "must be from 1 to 64.")
        if self.seed < 0:
            raise FieldError("seed", self.seed, "must be 0 or more.")
        if not self.arm:
            raise UsageError("`arm`: name an arm, or `default`.")
        if len(self.flange) not in (0, 1, len(self.arm)):
            raise FieldError(
                "flange", self.flange, f"must be one site, or one for each of the {len(self.arm)} arms."
            )
        check_base(self.base_mm, self.base_yaw_deg)
        self.case.check(self.organ)
        self._check_base_search()

    def _check_base_search(self) -> None:
        if self.base_search != 0 and not 10 <= self.base_search <= 5000:
            raise FieldError("base_search", self.base_search, "must be from 10 to 5000 bases, or 0.")
        if not 20 <= self.base_poses <= 100_000:
            raise FieldError("base_poses", self.base_poses, "must be from 20 to 100000.")
        low_mm, high_mm = self.base_height_mm
        if not -700.0 <= low_mm <= high_mm <= 2000.0:
            shown = (f"{low_mm:g}", f"{high_mm:g}")
            raise FieldError("base_height_mm", shown, "must be two rising heights from -700 to 2000 mm.")

    def flange_of(self, index: int) -> str | None:
        """The flange of one of the arms; None where none is named."""
        return self.flange[index if len(self.flange) > 1 else 0] if self.flange else None

    def out_folder(self, scenario: Scenario) -> Path:
        """The folder that the options name, or a new one that names scenario and arm."""
        if self.out is not None:
            return self.out
        arms = [file_part(arm) for arm in self.arm if len(self.arm) > 1 or arm != "default"]
        probes = [] if self.probe == "default" else [file_part(self.probe)]
        return default_folder(
            "-".join(["reach", scenario.name, *arms, *probes]), _recorded(self), overwrite=self.overwrite
        )

    def make_scenario(self) -> Scenario:
        """The scenario with what the command line changes about it."""
        changes = scenario_changes(self.organ, self.case, self.anatomy)
        try:
            return dataclasses.replace(load_scenario(self.scenario), **changes)
        except UsageError as error:
            raise in_fields(EpisodeConfig(case=self.case, anatomy=self.anatomy), error) from error

    def make_arm(self, index: int) -> ArmModel:
        """One of the arms, where it stands."""
        flange = self.flange_of(index)
        return arm_standing(self.arm[index], flange, base_mm=self.base_mm, base_yaw_deg=self.base_yaw_deg)

    def make_settings(self) -> StudySettings:
        """How each arm is studied."""
        from sim.reach.base_search import BaseQuestion
        from sim.reach.study import StudySettings

        low_mm, high_mm = self.base_height_mm
        question = BaseQuestion(
            n_bases=self.base_search,
            n_poses=self.base_poses,
            height_m=(low_mm * MM, high_mm * MM),
            objective=self.base_objective,
            seed=self.seed,
            n_jobs=self.jobs,
        )
        return StudySettings(
            max_tilt_rad=math.radians(self.tilt_deg),
            standoff_m=self.standoff_mm * MM,
            padding_m=self.padding_mm * MM,
            max_restarts=self.restarts,
            seed=self.seed,
            n_jobs=self.jobs,
            base=question if self.base_search else None,
            writes_parquet=self.parquet,
            overwrite=self.overwrite,
            options=_recorded(self),
        )


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Study the arm or the arms, print the results, and return the exit code."""
    from sim.reach.arm_comparison import compare_arms, folder_names
    from sim.reach.study import reach_study
    from sim.world.probes.probe import named_probe

    probe = named_probe(options.probe)
    scenario = options.make_scenario()
    out, settings = options.out_folder(scenario), options.make_settings()
    try:
        if len(options.arm) == 1:
            arm = options.make_arm(0)
            summary = reach_study(scenario, arm, out, settings, probe=probe, name=options.arm[0], notify=note)
            print(reach_table(summary))
            return 0
        names = folder_names(options.arm)
        arms = {name: options.make_arm(index) for index, name in enumerate(names)}
        print(arms_summary(compare_arms(scenario, arms, out, settings, probe=probe, notify=note)))
    except KeyboardInterrupt:
        print(
            "sounding: interrupted; a study writes its table at the end, so the folder is marked unfinished.",
            file=sys.stderr,
        )
        return INTERRUPTED
    return 0


def _recorded(options: Options) -> dict[str, Any]:
    """The options as config.json keeps them, with those of groups in their place."""
    values = dataclasses.asdict(options)
    return {**values.pop("case"), **values.pop("anatomy"), **values}


def reach_table(summary: Mapping[str, Any]) -> str:
    """The results of a reachability study as an aligned table, ending with the folder that holds them."""
    probe = f", probe {summary['probe']}" if "probe" in summary else ""
    head = f"{summary['scenario']}, arm {summary['arm']}{probe}"
    reasons = [
        f"not reached, {name.replace('_', ' ')}: {count}"
        for name, count in summary["reasons"].items()
        if name != "reached"
    ]
    tilts = [
        f"reached with a tilt of up to {tilt} degrees: {share:.2%}"
        for tilt, share in summary["reached_fraction_by_tilt_deg"].items()
    ]
    lines = [*aligned_lines(REACH_ROWS, summary), *reasons, *tilts, *_base_lines(summary)]
    return "\n".join([head, "-" * len(head), *lines, f"written to {summary['folder']}"])


def arms_summary(summary: Mapping[str, Any]) -> str:
    """The arms of a comparison as a table, ending with the folder that holds their studies."""
    return f"{summary['scenario']}\n\n{summary['table']}\nwritten to {summary['folder']}"


def _base_lines(summary: Mapping[str, Any]) -> list[str]:
    """Lines about what a search for a base found."""
    found = summary.get("base_search")
    if found is None:
        return []
    head = f"best of {found['n_bases']} bases, tried on {found['n_poses']} poses each"
    head += f" ({found['n_blocked']} more had no room)" if found["n_blocked"] else ""
    best, present = found["best_reached_fraction"], summary["reached_fraction"]
    lines = [
        "",
        f"{head}:",
        f"  reached from there  {best:.2%} of all poses, from the present base {present:.2%}",
    ]
    if found["objective"] == "seen":
        shares = (found[f"{name}_seen_fraction_by_sample"] for name in ("best", "present"))
        lines.append("  organ's inside seen {:.1%}, from the present base {:.1%}".format(*shares))
    if found["best_stage"] == "present":
        return [*lines, "  no candidate is better than the present base"]
    lines.append(f"  to put the base there: {_base_flags(found['best_base'])}")
    if (overhang_mm := found["best_overhang_m"] / MM) >= 1.0:
        lines.append(f"  there it stands across the table's edge, {overhang_mm:.0f} mm of it beyond")
    return lines


def _base_flags(place: Mapping[str, Any]) -> str:
    """The flags that put an arm's base at a place."""
    base_mm = " ".join(f"{value:g}" for value in place["base_mm"])
    return f"--base-mm {base_mm} --base-yaw-deg {place['base_yaw_deg']:g}"

"""What can be asked about an arm on the command line: pure data, in the units people type."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sim.episode.scenario import Scenario, Unit, load_scenario
from sim.errors import UsageError
from sim.running.organ_pose import pose_changes

MAX_POSITION_MM = 10_000.0
"""Positions farther out than this from the world's origin are a mistake of unit."""
METRES_MM = 3.0
"""A position all of whose numbers are below this was likely given in metres."""
Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class ReachOptions:
    """Ask an arm for every sensing pose of a scenario: which it reaches, how well, and why not the others.

    Writes reach.csv, summary.json, config.json, manifest.json, reach.png (the organ coloured by score) and reasons.png;
    with --base-search bases.csv and bases.png (where the base could stand) too. Several arms are compared on the one
    workspace: each has a folder of its own in the output folder, beside the table arms.csv, arms.md and arms.png.
    """

    scenario: str = "liver"
    """sphere, spheres (the paper's synthetic organ), liver, or the path of a scenario .toml."""
    arm: tuple[str, ...] = ("default",)
    """default (the embedded 7-joint arm), ur5e (with the extra `arms`), or the path of any MJCF arm; several of them
    are compared."""
    flange: tuple[str, ...] = ()
    """Site of the arm that carries the probe, one for all arms or one for each; by default the first of flange and
    attachment_site that the arm has."""
    base_mm: Triple = (0.0, 0.0, 0.0)
    """Where the arm's base stands in the world [mm]; the table's top is z = 0."""
    base_yaw_deg: float = 0.0
    """How the base is turned about the vertical [degrees]."""
    base_search: int = 0
    """Ask also where the base should stand, by this many candidate bases: from 10 to 5000, or 0 for not at all."""
    base_poses: int = 500
    """Poses of the workspace, drawn by seed, that each candidate base is asked for."""
    base_height_mm: tuple[float, float] = (0.0, 300.0)
    """Lowest and highest candidate base above the table's top [mm]."""
    base_objective: Literal["poses", "seen"] = "poses"
    """What makes a base good: the share of the poses that it reaches, or the share of the organ's inside that the
    probe's cone sees from those."""
    organ: Path | None = None
    """Replace the scenario's organ by this mesh or label volume."""
    unit: Unit = "mm"
    """Unit of the --organ file, if it is a mesh."""
    organ_label: tuple[int, ...] = ()
    """Labels of the organ in a label volume; by default told from the labels."""
    organ_pose: tuple[str, ...] = ()
    """How the organ lies: see `sounding episode --help`."""
    tilt_deg: float = 0.0
    """Ask again for the poses that are not reached with the probe tilted off the normal by up to this [degrees]."""
    restarts: int = 40
    """Further starts before a pose is called unreachable, from 0 to 119."""
    seed: int = 0
    """Seed of the set of starts; it should change nothing."""
    jobs: int = 2
    """Processes that share the poses; the answers do not depend on it."""
    out: Path | None = None
    """Folder to write to; renders/reach-<scenario> by default."""
    overwrite: bool = False
    """Replace a run that the folder already holds."""
    parquet: bool = False
    """Write reach.parquet beside reach.csv; needs the extra `parquet`."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not 0.0 <= self.tilt_deg <= 80.0:
            raise UsageError(f"--tilt-deg {self.tilt_deg}: from 0 to 80 degrees.")
        if not 0 <= self.restarts <= 119:
            raise UsageError(f"--restarts {self.restarts}: from 0 to 119.")
        if not 1 <= self.jobs <= 64:
            raise UsageError(f"--jobs {self.jobs}: from 1 to 64.")
        if self.seed < 0:
            raise UsageError(f"--seed {self.seed}: 0 or more.")
        if not self.arm:
            raise UsageError("--arm: name an arm, or `default`.")
        if len(self.flange) not in (0, 1, len(self.arm)):
            raise UsageError(
                f"--flange {' '.join(self.flange)}: one site, or one for each of the {len(self.arm)} arms."
            )
        check_base(self.base_mm, self.base_yaw_deg)
        self._check_base_search()

    def _check_base_search(self) -> None:
        if self.base_search != 0 and not 10 <= self.base_search <= 5000:
            raise UsageError(f"--base-search {self.base_search}: from 10 to 5000 bases, or 0.")
        if not 20 <= self.base_poses <= 100_000:
            raise UsageError(f"--base-poses {self.base_poses}: from 20 to 100000.")
        low_mm, high_mm = self.base_height_mm
        if not -700.0 <= low_mm <= high_mm <= 2000.0:
            raise UsageError(
                f"--base-height-mm {low_mm:g} {high_mm:g}: two rising heights from -700 to 2000 mm."
            )

    def flange_of(self, index: int) -> str | None:
        """The flange asked for of one of the arms; None where none is."""
        return self.flange[index if len(self.flange) > 1 else 0] if self.flange else None

    def make_scenario(self) -> Scenario:
        """The scenario with what the command line changes about it."""
        scenario = dataclasses.replace(load_scenario(self.scenario), **pose_changes(self.organ_pose))
        if self.organ is None:
            return scenario
        return dataclasses.replace(
            scenario,
            name=self.organ.name.split(".")[0],
            organ=str(self.organ),
            organ_unit=self.unit,
            organ_labels=self.organ_label,
            tumour_files=(),
            tumour_labels=(),
        )

    def out_folder(self, scenario: Scenario) -> Path:
        """The folder asked for, or the one that names the scenario."""
        return self.out or Path("renders") / f"reach-{scenario.name}"


@dataclass(frozen=True, kw_only=True)
class IkOptions:
    """Explain one sensing pose: whether the arm reaches it, with which joints, how close to limits and obstacles.

    Ends with exit code 0 where the pose is reached and 1 where it is not.
    """

    position_mm: Triple
    """Where the probe's tip shall touch, world frame [mm]. The table's top is z = 0."""
    normal: Triple = (0.0, 0.0, -1.0)
    """Direction of the beam, into the organ; of any length."""
    standoff_mm: float = 40.0
    """The pose is approached from this far above it [mm]; 0 asks for the pose alone."""
    scenario: str = "liver"
    """The organ that lies before the arm: sphere, spheres, liver, or the path of a scenario .toml."""
    arm: str = "default"
    """default (the embedded 7-joint arm), ur5e (with the extra `arms`), or the path of any MJCF arm."""
    flange: str | None = None
    """Site of the arm that carries the probe; by default the first of flange and attachment_site that it has."""
    base_mm: Triple = (0.0, 0.0, 0.0)
    """Where the arm's base stands in the world [mm]; the table's top is z = 0."""
    base_yaw_deg: float = 0.0
    """How the base is turned about the vertical [degrees]."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        check_base(self.base_mm, self.base_yaw_deg)
        if not all(math.isfinite(value) and abs(value) <= MAX_POSITION_MM for value in self.position_mm):
            raise UsageError(
                f"--position-mm {_spaced(self.position_mm)}: finite numbers of at most {MAX_POSITION_MM:.0f} mm."
            )
        if not all(math.isfinite(value) for value in self.normal) or not any(self.normal):
            raise UsageError(f"--normal {_spaced(self.normal)}: three finite numbers, not all zero.")
        if not 0.0 <= self.standoff_mm <= 500.0:
            raise UsageError(f"--standoff-mm {self.standoff_mm}: from 0 to 500 mm.")


def check_base(base_mm: Triple, base_yaw_deg: float) -> None:
    """Nothing, if a base can stand there.

    Raises:
        UsageError: Numbers that are not finite or too large, or a position that was likely given in metres.
    """
    if not all(math.isfinite(value) and abs(value) <= MAX_POSITION_MM for value in base_mm):
        raise UsageError(f"--base-mm {_spaced(base_mm)}: finite numbers of at most {MAX_POSITION_MM:.0f} mm.")
    if 0.0 < max(abs(value) for value in base_mm) < METRES_MM:
        raise UsageError(f"--base-mm {_spaced(base_mm)}: below {METRES_MM:g} mm; was it given in metres?")
    if not math.isfinite(base_yaw_deg) or abs(base_yaw_deg) > 360.0:
        raise UsageError(f"--base-yaw-deg {base_yaw_deg:g}: from -360 to 360 degrees.")


def _spaced(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:g}" for value in values)

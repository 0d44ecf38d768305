"""What can be asked about an arm on the command line: pure data, in the units people type."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

from .errors import UsageError
from .scenarios import Scenario, Unit, load_scenario

MAX_POSITION_MM = 10_000.0
"""Positions farther out than this from the arm's base are a mistake of unit."""


@dataclass(frozen=True, kw_only=True)
class ReachOptions:
    """Ask an arm for every sensing pose of a scenario: which it reaches, how well, and why not the others.

    Writes reach.csv, summary.json, config.json, manifest.json, reach.png (the organ coloured by score) and reasons.png.
    """

    scenario: str = "liver"
    """sphere, spheres (the paper's synthetic organ), liver, or the path of a scenario .toml."""
    arm: str = "default"
    """default (the embedded 7-joint arm), or the path of any MJCF arm."""
    flange: str = "flange"
    """Site of the arm that carries the probe."""
    organ: Path | None = None
    """Replace the scenario's organ by this mesh (STL, OBJ, PLY)."""
    unit: Unit = "mm"
    """Unit of the --organ file."""
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
    """Write reach.parquet beside reach.csv; needs `pip install pyarrow`."""

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

    def make_scenario(self) -> Scenario:
        """The scenario with what the command line changes about it."""
        scenario = load_scenario(self.scenario)
        if self.organ is None:
            return scenario
        return dataclasses.replace(
            scenario, name=self.organ.stem, organ=str(self.organ), organ_unit=self.unit, tumour_files=()
        )

    def out_folder(self, scenario: Scenario) -> Path:
        """The folder asked for, or the one that names the scenario."""
        return self.out or Path("renders") / f"reach-{scenario.name}"


@dataclass(frozen=True, kw_only=True)
class IkOptions:
    """Explain one sensing pose: whether the arm reaches it, with which joints, how close to limits and obstacles.

    Ends with exit code 0 where the pose is reached and 1 where it is not.
    """

    position_mm: tuple[float, float, float]
    """Where the probe's tip shall touch, world frame [mm]. The arm's base is the origin, the table is z = 0."""
    normal: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """Direction of the beam, into the organ; of any length."""
    standoff_mm: float = 40.0
    """The pose is approached from this far above it [mm]; 0 asks for the pose alone."""
    scenario: str = "liver"
    """The organ that lies before the arm: sphere, spheres, liver, or the path of a scenario .toml."""
    arm: str = "default"
    """default (the embedded 7-joint arm), or the path of any MJCF arm."""
    flange: str = "flange"
    """Site of the arm that carries the probe."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if not all(math.isfinite(value) and abs(value) <= MAX_POSITION_MM for value in self.position_mm):
            raise UsageError(
                f"--position-mm {_spaced(self.position_mm)}: finite numbers of at most {MAX_POSITION_MM:.0f} mm."
            )
        if not all(math.isfinite(value) for value in self.normal) or not any(self.normal):
            raise UsageError(f"--normal {_spaced(self.normal)}: three finite numbers, not all zero.")
        if not 0.0 <= self.standoff_mm <= 500.0:
            raise UsageError(f"--standoff-mm {self.standoff_mm}: from 0 to 500 mm.")


def _spaced(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:g}" for value in values)

"""`sounding ik`: one sensing pose, explained."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sim.episode.scenario_file import load_scenario
from sim.errors import FieldError
from sim.running.case import MM, AnatomyConfig, CaseConfig, metres, scenario_changes
from sim.running.placing.arm_place import MAX_POSITION_MM, METRES_MM, arm_standing, check_base, check_padding

from .terminal import NOT_REACHED, note, parse

Triple = tuple[float, float, float]

EXAMPLES = """
sounding ik --position-mm 500 0 120
sounding ik --position-mm 500 0 120 --normal 0 0.3 -1 --standoff-mm 60
sounding ik --position-mm 500 0 120 --arm my_arm.xml --flange hand
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Explain one sensing pose: whether the arm reaches it, with which joints, and how near to limits and obstacles.

    The exit code is 0 where the pose is reached, and 1 where it is not.
    """

    position_mm: Triple
    """Where the probe's tip is to touch, world frame [mm]; the table's top is z = 0."""
    normal: Triple = (0.0, 0.0, -1.0)
    """Direction of the beam into the organ, of any length."""
    standoff_mm: float = 40.0
    """Distance above the pose from which the probe approaches it [mm]; with 0 only the pose is solved."""
    padding_mm: float = 0.0
    """Room that arm and probe keep from the table, and the arm from itself and beyond its 3 mm from the organ [mm]."""
    scenario: str = "liver"
    """Scenario whose organ lies before the arm: sphere, spheres, liver, or the path of a scenario file (.toml)."""
    organ: Path | None = None
    """Mesh or label volume that replaces the scenario's organ."""
    arm: str = "default"
    """Arm: default (the embedded one with 7 joints), ur5e (with the extra `arms`), or the path of an MJCF file."""
    flange: str | None = None
    """Site or body of the arm that carries the probe, +z out of it; by default the site flange or attachment_site, or
    the body tool0 or flange."""
    probe: str = "default"
    """Probe: default (the embedded one, straight and 160 mm long), or the path of an MJCF file that has a site named
    tip."""
    base_mm: Triple = (0.0, 0.0, 0.0)
    """Where the arm's base stands in the world [mm]; the table's top is z = 0."""
    base_yaw_deg: float = 0.0
    """Angle by which the base is turned about the vertical [degrees]."""
    case: CaseConfig = field(default_factory=CaseConfig)
    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)

    def __post_init__(self) -> None:
        """Validate the ranges."""
        check_base(self.base_mm, self.base_yaw_deg)
        self.case.check(self.organ)
        if not all(math.isfinite(value) and abs(value) <= MAX_POSITION_MM for value in self.position_mm):
            raise FieldError(
                "position_mm",
                _short(self.position_mm),
                f"must be finite numbers of at most {MAX_POSITION_MM:.0f} mm.",
            )
        if not all(math.isfinite(value) for value in self.normal) or not any(self.normal):
            raise FieldError("normal", _short(self.normal), "must be three finite numbers, not all zero.")
        if not 0.0 <= self.standoff_mm <= 500.0:
            raise FieldError("standoff_mm", self.standoff_mm, "must be from 0 to 500 mm.")
        check_padding(self.padding_mm)


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Explain the pose, and return the exit code, 0 where it is reached."""
    from sim.reach.explanation import explain_pose
    from sim.reach.workcell import build_workcell
    from sim.world.probes.probe import named_probe

    arm = arm_standing(
        options.arm, options.flange, base_mm=options.base_mm, base_yaw_deg=options.base_yaw_deg
    )
    changes = scenario_changes(options.organ, options.case, options.anatomy)
    scenario = dataclasses.replace(load_scenario(options.scenario), **changes)
    workcell = build_workcell(scenario, arm, named_probe(options.probe))
    for text in workcell.notices:
        note(text)
    explanation = explain_pose(
        workcell,
        metres(options.position_mm),
        options.normal,
        standoff_m=options.standoff_mm * MM,
        padding_m=options.padding_mm * MM,
    )
    if 0.0 < max(abs(value) for value in options.position_mm) < METRES_MM:
        print("note             the position is in millimetres; was it given in metres?")
    print(explanation.text)
    return 0 if explanation.is_reached else NOT_REACHED


def _short(values: tuple[float, ...]) -> tuple[str, ...]:
    return tuple(f"{value:g}" for value in values)

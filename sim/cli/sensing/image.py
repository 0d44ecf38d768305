"""`sounding image`: one B-mode picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from sim.cli.terminal import parse
from sim.errors import FieldError
from sim.record.default_folders import file_part, first_path
from sim.running.case import MM, AnatomyConfig, CaseConfig
from sim.running.config import ULTRASOUND, SensingConfig
from sim.running.fields import episode_of
from sim.running.parts import scenario_of
from sim.running.reader import ReaderConfig
from sim.running.sensor import image_reader_of
from sim.running.ultrasound import UltrasoundConfig, ultrasound_sensor_of

EXAMPLES = """
sounding image
sounding image --scenario generated-liver --seed 7 --pose 520 10 150
sounding image --reader image
sounding image --pose 1200 --rock-deg 8 --tumour-tissue hyperechoic --out lesion.png
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Draw one B-mode picture of a scenario, as the sensor ultrasound sees it from a sensing pose."""

    scenario: str = "liver"
    """Scenario: sphere, spheres, liver, generated-liver, or the path of a scenario file (.toml)."""
    organ: Path | None = None
    """Mesh or label volume that replaces the scenario's organ."""
    seed: int = 0
    """Seed of the tumours, as in `sounding episode`."""
    pose: tuple[float, ...] | None = None
    """The number of a sensing pose, or a place x y z near which one is taken, world frame [mm]; by default the pose
    that looks straight at the largest tumour."""
    rock_deg: float = 0.0
    """Angle by which the plane is rocked about the contact [degrees]."""
    reader: Literal["exact", "image"] = "exact"
    """What says where in the picture tumour is: exact (the truth), or image (the reader of pictures, whose outline is
    drawn)."""
    reader_weights: Path | None = None
    """Weights of the reader image (.safetensors); by default those that come along."""
    out: Path | None = None
    """Picture to draw (.png); by default renders/image-<scenario>-<seed>.png, with a number behind the name where that
    is taken."""
    case: CaseConfig = field(default_factory=CaseConfig)
    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    ultrasound: UltrasoundConfig = field(default_factory=UltrasoundConfig)

    def __post_init__(self) -> None:
        """Validate the ranges."""
        if self.pose is not None and len(self.pose) not in (1, 3):
            raise FieldError("pose", self.pose, "give the number of a pose, or a place as x y z.")
        if self.pose is not None and not all(math.isfinite(each) for each in self.pose):
            raise FieldError("pose", self.pose, "must be finite numbers.")
        if not abs(self.rock_deg) < 90.0:
            raise FieldError("rock_deg", self.rock_deg, "must be between -90 and 90 degrees.")
        if self.out is not None and self.out.suffix.lower() != ".png":
            raise FieldError("out", self.out, "must end with .png.")


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Draw the picture, print what it shows, and return the exit code."""
    reading = ReaderConfig(reader=options.reader, reader_weights=options.reader_weights)
    config = episode_of(options, sensor=ULTRASOUND, arm="none", reading=reading)
    sensor, scenario = ultrasound_sensor_of(options.ultrasound), scenario_of(config)
    reader = image_reader_of(config)
    # Imported here, since MuJoCo takes half a second, and help needs none of it.
    from sim.viewing.bmode import draw_plane

    name = f"image-{file_part(scenario.name)}-{options.seed}.png"
    out = options.out or first_path(name, lambda path: not path.exists())
    pose = options.pose
    drawn = draw_plane(
        scenario,
        sensor,
        seed=options.seed,
        pose=pose if pose is None or len(pose) == 1 else tuple(each * MM for each in pose),
        rock_rad=math.radians(options.rock_deg),
        out=out,
        reader=reader,
    )
    print(f"{drawn.text}\nwritten to       {out}")
    return 0

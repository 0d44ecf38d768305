"""An episode as plain data, in the units that people type: what the command line, study files and config.json hold.

Fields are known by their own names, whatever group they stand in; `sim.running.fields` finds them by name.
`sim.running.parts` makes scenario, planner, sensor, map and motion from the data.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import Literal

from planner import planner_names
from sim.errors import FieldError
from sim.live.address import live_address
from sim.plugs import MAP, PLANNER, SENSOR, is_plug
from sim.suggestions import did_you_mean
from sim.world.motion.settings import MotionKind

from .case import AnatomyConfig, CaseConfig
from .placing.body import BodyConfig
from .reader import ReaderConfig
from .sweep import SweepConfig
from .ultrasound import UltrasoundConfig

Frames = Literal["each", "last", "none"]
MapName = Literal["paper", "calibrated"]
PlanFor = Literal["tumours", "target"]
ALWAYS, WHEN_NEEDED = "always", "when-needed"
"""The choices of when the built-in map is kept."""
DEFAULT_PROBE = "default"  # the embedded probe
CONE, CONE_WITH_ERRORS, ULTRASOUND = "cone", "cone-with-errors", "ultrasound"
"""The names of the paper's exact sensor, of the same whose reader errs, and of the one that draws pictures."""
SENSORS = (CONE, CONE_WITH_ERRORS, ULTRASOUND)


@dataclass(frozen=True, kw_only=True)
class SensingConfig:
    """What a contact of the probe senses, and options of your own sensor."""

    cone_half_angle_deg: float | None = None
    """Half-angle of the probe's cone [degrees]; by default that of the scenario, 11.5, or 15 for the livers."""
    cone_depth_mm: float | None = None
    """Depth of the probe's cone [mm]; by default that of the scenario, 102, or 130 for the livers."""
    sensor_option: tuple[str, ...] = ()
    """Options of your own sensor as name=value, which are the keyword arguments of its class."""


@dataclass(frozen=True, kw_only=True)
class PlanningConfig:
    """What the planner is shown, and options of your own planner."""

    plan_for: PlanFor = "tumours"
    """Whose map the planner is shown, and whose share `until_sensed` means: tumours or target (the second class)."""
    planner_option: tuple[str, ...] = ()
    """Options of your own planner, or of a baseline, as name=value, which are the keyword arguments of its class."""


@dataclass(frozen=True, kw_only=True)
class FindAndOutlineConfig:
    """Options of the planner find-and-outline."""

    travel_weight: float = 0.0
    """How much a second of transfer counts against a second of sensing. 0 gives the fewest actions; docs/results.md
    tells what larger weights bring."""
    batch: int = 1
    """Number of poses that the search chooses together, of which it takes the first on the shortest way through all."""
    sure_radius_mm: float = 8.0
    """Least radius of the tumours that the planner's confidence, and so `until_confident`, is about [mm]."""
    lesion_number: float = 6.5
    """Mean number of lesions that are expected in the organ before anything is sensed. `miss_cost`, and what is told to
    be left, go by this and the next three; the defaults are those of the patients of LiTS."""
    lesion_number_shape: float = 0.55
    """Shape of the negative binomial distribution of that number: below 1 most have few lesions and some have many."""
    lesion_diameter_mm: float = 16.0
    """Median diameter of the lesions that are expected, from 5 to 100 [mm]."""
    lesion_diameter_spread: float = 0.69
    """Standard deviation of the logarithm of that diameter, from 0 (all of one size) to 3."""


@dataclass(frozen=True, kw_only=True)
class ExpectedImprovementConfig:
    """Options of the planner expected-improvement."""

    ei_values: Literal["latent", "probability"] = "latent"
    """What is to improve: the map's latent or its probability."""
    ei_pose_rule: Literal["best-aligned", "first-within-threshold"] = "best-aligned"
    """Which pose looks at the point of highest expected improvement: the best aligned one, or the first that is aligned
    to within `ei_threshold_deg`."""
    ei_threshold_deg: float = 5.0
    """Largest misalignment of a pose under the rule first-within-threshold [degrees]."""
    ei_exclusion_share: float = 0.28
    """Poses nearer to a sensed pose than this share of the radius of the cone's base are chosen last."""
    ei_reuse_poses: bool = False
    """Let the planner return to poses that were sensed already."""


@dataclass(frozen=True, kw_only=True)
class MappingConfig:
    """The map of the tumours."""

    map: str = ALWAYS
    """Map to keep: always (the built-in map), when-needed (the built-in map only for a planner that needs it; without a
    map an episode is far faster, and only the share of the tumours sensed is scored), or your own as
    package.module:Class."""
    map_option: tuple[str, ...] = ()
    """Options of your own map as name=value, which are the keyword arguments of its class."""
    map_form: Literal["full", "diagonal"] = "full"
    """What the map keeps: full (the covariance of its weights) or diagonal (only their variances, which is faster and
    far worse)."""
    map_settings: MapName | None = None
    """Settings of the map, by default those that the planner prefers: paper for expected-improvement and the baselines,
    calibrated for all others. paper expects half of the organ to be tumour, as the paper does, under which expected
    improvement explores; calibrated expects 2 per cent, and its probabilities mean what they say."""
    map_detail: Literal["on", "off"] | None = None
    """Whether the map answers in detail near sensed tumour and doubts itself far from what was sensed; by default on
    with calibrated settings, and off with those of the paper."""
    prior_prevalence: float | None = None
    """Share of the organ that is expected to be tumour before anything is sensed, in place of that of
    `map_settings`."""
    weight_variance: float | None = None
    """Prior variance of each of the map's weights, in place of that of `map_settings`."""
    em_iterations: int | None = None
    """Rounds of the variational bound within one reading."""
    false_positive_rate: float | None = None
    """Share of free points that the map takes the sensor to call tumour; 0 by default, and the two rates add up to less
    than 1."""
    false_negative_rate: float | None = None
    """Share of tumour points that the map takes the sensor to call free; 0 by default."""


@dataclass(frozen=True, kw_only=True)
class MountingConfig:
    """How the arm is mounted."""

    flange: str | None = None
    """Site or body of the arm that carries the probe, +z out of it; by default the site flange or attachment_site, or
    the body tool0 or flange."""
    base_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the arm's base stands in the world [mm]; the table's top is z = 0."""
    base_yaw_deg: float = 0.0
    """Angle by which the base is turned about the vertical [degrees]."""


@dataclass(frozen=True, kw_only=True)
class MovingConfig:
    """How the probe gets from pose to pose, and how long a sensing action takes."""

    motion: MotionKind = "kinematic"
    """Motion of the probe: kinematic (along a timed, collision-free path), servo (the same path sent to simulated
    servos, with the probe pressing on a compliant organ), or none (the probe jumps, which is cheapest, and its time is
    estimated)."""
    joint_speed: float | None = None
    """Speed limit of every joint [rad/s, or m/s of a slide]; by default those that a URDF states or the maker of the
    arm publishes, where it is known, and otherwise 1.0."""
    joint_acceleration: float | None = None
    """Acceleration limit of every joint [rad/s^2, or m/s^2 of a slide]; by default those that the maker of the arm
    publishes, where it is known and does, and otherwise 4.0."""
    tip_speed_mm_s: float = 250.0
    """Speed limit of the probe's tip between poses [mm/s]."""
    approach_speed_mm_s: float = 50.0
    """Speed limit of the tip on its way to and from the organ [mm/s]."""
    press_mm: float = 2.0
    """How far below the surface servo motion sends the tip [mm]."""
    stiffness_n_m: float | None = None
    """Stiffness of the organ under the tip in servo motion [N/m]; by default that of healthy liver under the probe's
    face, 87 for the embedded probe."""
    force_limit_n: float = 5.0
    """Contact force at which the arm stops and the run ends in servo motion [N]."""
    sensing_s: float = 2.0
    """Modelled time of one sensing action [s], which is a part of the procedure's time."""


@dataclass(frozen=True, kw_only=True)
class OutputConfig:
    """What is written besides the tables."""

    report: bool = True
    """Write report.html, a page that shows the run from its first action to its last."""
    overwrite: bool = False
    """Replace a run that the folder already holds."""
    live: str | None = None
    """Show the run as it happens: igtl://127.0.0.1:18944 (extra `igtl`), or a rosbridge, ws://127.0.0.1:9090."""

    def __post_init__(self) -> None:
        """Validate the address."""
        if self.live is not None:
            live_address(self.live, "live")


@dataclass(frozen=True, kw_only=True)
class EpisodeConfig:
    """Run one headless episode: sense, map, plan, move, until the steps are used up.

    The output folder gets config.json, manifest.json, steps.csv, states.csv, summary.json, map.npz, figures and frames.
    It is written as the episode goes, so stopping the episode at any moment keeps what was done.
    """

    scenario: str = "liver"
    """Scenario: sphere or spheres (the paper's synthetic organ with 1 or 3 tumours), liver, generated-liver (a new one
    for each seed), or the path of a scenario file (.toml)."""
    organ: Path | None = None
    """Mesh (STL, OBJ, PLY, GLB, glTF) or label volume (.nii, .nii.gz, .nrrd) that replaces the scenario's organ."""
    planner: str = "find-and-outline"
    """What chooses the next pose: find-and-outline, expected-improvement (the paper's), trained, random,
    multi-resolution, greedy-coverage, upper-confidence-bound, probability-of-improvement, thompson-sampling,
    mutual-information, expected-volume; of paths find-and-outline-paths, boustrophedon, ergodic, a-star; or your
    own as package.module:Class."""
    sensor: str = CONE
    """What turns a contact into a reading: cone (the paper's, which is exact), cone-with-errors (the same, labelled by
    a reader that errs), ultrasound (a sweep of B-mode pictures), or your own sensor as package.module:Class."""
    steps: int = 30
    """Largest number of sensing actions, from 1 to 14400."""
    until_sensed: float | None = None
    """Stop as soon as this share of the tumours was sensed, for example 0.95."""
    until_confident: float | None = None
    """Stop as soon as the planner is this confident that no tumour is left to find or outline, for example 0.95.
    Planners that tell no confidence refuse it. What lies in no pose's cone is left out; the results tell how much."""
    miss_cost: float | None = None
    """Stop as soon as nothing is left to outline and going on is not worth it, where a missed lesion is worth this many
    sensing actions, for example 100. The lesions that are expected are those of `lesion_number` and its neighbours.
    Planners that do not weigh this refuse it. Beside `until_confident`, what is met first ends the episode."""
    seed: int = 0
    """Seed of everything random. Planners that are given one seed face the same tumours."""
    arm: str = "default"
    """Arm that carries the probe: default (the embedded one with 7 joints), ur5e (with the extra `arms`), none (a
    free-flying probe), or the path of an MJCF file."""
    probe: str = DEFAULT_PROBE
    """Probe: default (the embedded one, straight and 160 mm long), or the path of an MJCF file that has a site named
    tip."""
    frames: Frames = "none"
    """Pictures of the scene to draw: each (one per action), last (only the final one), or none."""
    out: Path | None = None
    """Folder to write to; by default renders/<scenario>-<planner>-<arm>-<seed>, without the arm where it is the
    embedded one, and with a number behind where that is taken."""
    config: Path | None = None
    """Take the options of an earlier run from its config.json; options that are given beside it take precedence."""
    case: CaseConfig = field(default_factory=CaseConfig)
    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    reading: ReaderConfig = field(default_factory=ReaderConfig)
    ultrasound: UltrasoundConfig = field(default_factory=UltrasoundConfig)
    body: BodyConfig = field(default_factory=BodyConfig)
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    find_and_outline: FindAndOutlineConfig = field(default_factory=FindAndOutlineConfig)
    expected_improvement: ExpectedImprovementConfig = field(default_factory=ExpectedImprovementConfig)
    mapping: MappingConfig = field(default_factory=MappingConfig)
    mounting: MountingConfig = field(default_factory=MountingConfig)
    moving: MovingConfig = field(default_factory=MovingConfig)
    sweeping: SweepConfig = field(default_factory=SweepConfig)
    output: OutputConfig = field(default_factory=OutputConfig)

    def __post_init__(self) -> None:
        """Validate what the parts do not."""
        self._check_finite()
        if not 1 <= self.steps <= 14_400:
            raise FieldError("steps", self.steps, "must be from 1 to 14400.")
        if self.until_sensed is not None and not 0.0 < self.until_sensed <= 1.0:
            raise FieldError("until_sensed", self.until_sensed, "must be above 0 and at most 1.")
        if self.until_confident is not None and not 0.0 < self.until_confident < 1.0:
            raise FieldError("until_confident", self.until_confident, "must be above 0 and below 1.")
        if self.miss_cost is not None and not self.miss_cost > 0.0:
            raise FieldError("miss_cost", self.miss_cost, "must be above 0.")
        if self.seed < 0:
            raise FieldError("seed", self.seed, "must be 0 or more.")
        self._check_names()
        if self.moving.motion == "servo" and self.arm == "none":
            raise FieldError(
                "motion", "servo", "a free-flying probe has no servos. Name an arm, or leave `motion` out."
            )
        self.case.check(self.organ)

    def _check_finite(self) -> None:
        """Check that every number is finite, also those that this run has no use for."""
        groups = [value for value in vars(self).values() if is_dataclass(value)]
        for name, value in (item for owner in (self, *groups) for item in vars(owner).items()):
            numbers = value if isinstance(value, tuple) else (value,)
            if any(isinstance(each, float) and not math.isfinite(each) for each in numbers):
                raise FieldError(name, value, "must be a finite number.")

    def _check_names(self) -> None:
        """Check that planner, sensor and map are known or brought along."""
        kept = self.mapping.map
        if self.planner not in planner_names() and not is_plug(self.planner, PLANNER):
            known = ", ".join(planner_names())
            remedy = f"choose one of {known}, or name yours as package.module:Class."
            raise FieldError(
                "planner", self.planner, f"{remedy}{did_you_mean(self.planner, planner_names())}"
            )
        if self.sensor not in SENSORS and not is_plug(self.sensor, SENSOR):
            remedy = f"choose {', '.join(SENSORS)}, or name yours as package.module:Class."
            raise FieldError("sensor", self.sensor, f"{remedy}{did_you_mean(self.sensor, SENSORS)}")
        if kept not in (ALWAYS, WHEN_NEEDED) and not is_plug(kept, MAP):
            raise FieldError(
                "map", kept, f"choose {ALWAYS} or {WHEN_NEEDED}, or name your map as package.module:Class."
            )

"""An episode as plain data, in the units that people type: what the command line, study files and config.json hold.

Fields are known by their own names, whatever group they stand in; `sim.running.fields` looks at them so. How the data
becomes scenario, planner, sensor, map and motion is told in `sim.running.parts`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from planner import planner_names
from sim.errors import FieldError
from sim.plugs import MAP, PLANNER, SENSOR, is_plug
from sim.world.motion.settings import MotionKind

from .case import AnatomyConfig, CaseConfig

Frames = Literal["each", "last", "none"]
MapName = Literal["paper", "calibrated"]
PlanFor = Literal["tumours", "target"]
ALWAYS, WHEN_NEEDED = "always", "when-needed"
"""When the built-in map is kept."""
CONE = "cone"
"""The paper's sensor, which is exact."""


@dataclass(frozen=True, kw_only=True)
class SensingConfig:
    """What a contact of the probe senses."""

    cone_half_angle_deg: float | None = None
    """Half-angle of the probe's cone [degrees]; the scenario's by default: 11.5, for the liver 15."""
    cone_depth_mm: float | None = None
    """Depth of the probe's cone [mm]; the scenario's by default: 102, for the liver 130."""
    sensor_option: tuple[str, ...] = ()
    """Options of a sensor of one's own, as name=value: the keyword arguments of its class."""


@dataclass(frozen=True, kw_only=True)
class PlanningConfig:
    """What the planner is shown, and options of a planner of one's own."""

    plan_for: PlanFor = "tumours"
    """Whose map the planner is shown, tumours or target; until_sensed goes with it."""
    planner_option: tuple[str, ...] = ()
    """Options of a planner of one's own, as name=value: the keyword arguments of its class."""


@dataclass(frozen=True, kw_only=True)
class FindAndOutlineConfig:
    """Options of the planner find-and-outline."""

    travel_weight: float = 0.0
    """How much a second of transfer counts against one of sensing. 0 gives the fewest actions; docs/results.md tells
    what more brings."""
    batch: int = 1
    """Poses that its search chooses together; it takes the first on the shortest way through them."""
    sure_radius_mm: float = 8.0
    """Its confidence, and so until_confident, speaks of tumours of this radius and more [mm]."""


@dataclass(frozen=True, kw_only=True)
class ExpectedImprovementConfig:
    """Options of the planner expected-improvement."""

    ei_values: Literal["latent", "probability"] = "latent"
    """Expected improvement of the map's latent or of its probability."""
    ei_pose_rule: Literal["best-aligned", "first-within-threshold"] = "best-aligned"
    """Which pose looks at the point of highest expected improvement."""
    ei_threshold_deg: float = 5.0
    """Largest misalignment for first-within-threshold [degrees]."""
    ei_exclusion_share: float = 0.28
    """Poses nearer to a sensed one than this share of the radius of the cone's base are chosen last."""
    ei_reuse_poses: bool = False
    """Let expected improvement return to poses that were sensed already."""


@dataclass(frozen=True, kw_only=True)
class MappingConfig:
    """The map of the tumours."""

    map: str = ALWAYS
    """always keeps the built-in map. when-needed leaves it out where the planner needs none: far faster, and only the
    share of the tumours sensed is scored. package.module:Class keeps a map of one's own."""
    map_option: tuple[str, ...] = ()
    """Options of a map of one's own, as name=value: the keyword arguments of its class."""
    map_form: Literal["full", "diagonal"] = "full"
    """full keeps the covariance of the map's weights, diagonal only their variances (faster, far worse)."""
    map_settings: MapName | None = None
    """By default what the planner prefers: paper for expected-improvement and the baselines, calibrated for all
    others. paper is what the paper assumes, half of the organ tumour, under which expected improvement explores;
    calibrated expects 2 per cent, and its probabilities mean what they say."""
    map_insets: Literal["on", "off"] | None = None
    """Finer maps laid in where tumour was sensed; by default on with calibrated settings and off with the paper's."""
    prior_prevalence: float | None = None
    """Share of the organ expected to be tumour before anything is sensed, in place of that of map_settings."""
    weight_variance: float | None = None
    """Prior variance of each of the map's weights, in place of that of map_settings."""
    em_iterations: int | None = None
    """Rounds of the variational bound within one reading."""


@dataclass(frozen=True, kw_only=True)
class MountingConfig:
    """How the arm is mounted."""

    flange: str | None = None
    """Site or body of the arm that carries the probe, +z out of it; by default the site flange or attachment_site, or
    the body tool0 or flange."""
    base_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the arm's base stands in the world [mm]; the table's top is z = 0."""
    base_yaw_deg: float = 0.0
    """How the base is turned about the vertical [degrees]."""


@dataclass(frozen=True, kw_only=True)
class MovingConfig:
    """How the probe gets from pose to pose, and how long a sensing action takes."""

    motion: MotionKind = "kinematic"
    """kinematic (along a timed, collision-free path), servo (the same path sent to simulated servos, the probe pressing
    on a compliant organ), none (the probe jumps; cheapest, the time is estimated)."""
    joint_speed: float | None = None
    """Speed limit of every joint [rad/s, slides m/s]. The published ones for the default arm, 1.0 for any other."""
    joint_acceleration: float | None = None
    """Acceleration limit of every joint [rad/s^2, slides m/s^2]. Published for the default arm, 4.0 for any other."""
    tip_speed_mm_s: float = 250.0
    """Speed limit of the probe's tip between poses [mm/s]."""
    approach_speed_mm_s: float = 50.0
    """Speed limit of the tip on its way to and from the organ [mm/s]."""
    press_mm: float = 2.0
    """With servo motion: how far below the surface the tip is sent [mm]."""
    stiffness_n_m: float | None = None
    """With servo motion: spring of the organ under the tip [N/m]; 87, healthy liver under the probe's face."""
    force_limit_n: float = 5.0
    """With servo motion: contact force at which the arm stops and the run ends [N]."""
    sensing_s: float = 2.0
    """Modelled time of one sensing action [s], which adds to the procedure's."""


@dataclass(frozen=True, kw_only=True)
class OutputConfig:
    """What is written besides the tables."""

    report: bool = True
    """Write report.html, a page that shows the run from its first action to its last."""
    overwrite: bool = False
    """Replace a run that the folder already holds."""


@dataclass(frozen=True, kw_only=True)
class EpisodeConfig:
    """Run one headless episode: sense, map, plan, move, until the steps are used up.

    Writes config.json, manifest.json, steps.csv, states.csv, summary.json, map.npz, figures and frames to the output
    folder as it goes; stopping it at any moment keeps what was done.
    """

    scenario: str = "liver"
    """sphere, spheres (the paper's synthetic organ with 1 or 3 tumours), liver, generated-liver (another for each
    seed), or the path of a scenario .toml."""
    organ: Path | None = None
    """Replace the scenario's organ by this mesh (STL, OBJ, PLY, GLB, glTF) or label volume (.nii, .nii.gz, .nrrd)."""
    planner: str = "find-and-outline"
    """What chooses the next pose: find-and-outline, expected-improvement (the paper's), random, multi-resolution, or a
    planner of one's own as package.module:Class."""
    sensor: str = CONE
    """What turns a contact into a reading: cone (the paper's, exact), or a sensor of one's own as
    package.module:Class."""
    steps: int = 30
    """Sensing actions at most, from 1 to 14400."""
    until_sensed: float | None = None
    """Stop as soon as this share of the tumours was sensed, for example 0.95."""
    until_confident: float | None = None
    """Stop as soon as the planner is this confident that no tumour is left to find or outline, for example 0.95."""
    seed: int = 0
    """Seed of everything random. Planners given one seed face the same tumours."""
    arm: str = "default"
    """default (the embedded 7-joint arm), ur5e (with the extra `arms`), none (a free-flying probe), or the path of any
    MJCF arm."""
    frames: Frames = "none"
    """Pictures of the scene: each (one per action), last (the final one), none."""
    out: Path | None = None
    """Folder to write to; renders/<scenario>-<planner>-<seed> by default."""
    config: Path | None = None
    """Take the options of an earlier run from its config.json; those given beside it take precedence."""
    case: CaseConfig = field(default_factory=CaseConfig)
    anatomy: AnatomyConfig = field(default_factory=AnatomyConfig)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    planning: PlanningConfig = field(default_factory=PlanningConfig)
    find_and_outline: FindAndOutlineConfig = field(default_factory=FindAndOutlineConfig)
    expected_improvement: ExpectedImprovementConfig = field(default_factory=ExpectedImprovementConfig)
    mapping: MappingConfig = field(default_factory=MappingConfig)
    mounting: MountingConfig = field(default_factory=MountingConfig)
    moving: MovingConfig = field(default_factory=MovingConfig)
    output: OutputConfig = field(default_factory=OutputConfig)

    def __post_init__(self) -> None:
        """Validate what the parts do not."""
        if not 1 <= self.steps <= 14_400:
            raise FieldError("steps", self.steps, "from 1 to 14400.")
        if self.until_sensed is not None and not 0.0 < self.until_sensed <= 1.0:
            raise FieldError("until_sensed", self.until_sensed, "above 0 and at most 1.")
        if self.until_confident is not None and not 0.0 < self.until_confident < 1.0:
            raise FieldError("until_confident", self.until_confident, "between 0 and 1, both excluded.")
        if self.seed < 0:
            raise FieldError("seed", self.seed, "0 or more.")
        if self.planner not in planner_names() and not is_plug(self.planner, PLANNER):
            known = ", ".join(planner_names())
            raise FieldError(
                "planner", self.planner, f"choose one of {known}, or name yours as package.module:Class."
            )
        if self.sensor != CONE and not is_plug(self.sensor, SENSOR):
            raise FieldError("sensor", self.sensor, f"choose {CONE}, or name yours as package.module:Class.")
        kept = self.mapping.map
        if kept not in (ALWAYS, WHEN_NEEDED) and not is_plug(kept, MAP):
            raise FieldError(
                "map", kept, f"choose {ALWAYS} or {WHEN_NEEDED}, or name your map as package.module:Class."
            )
        if self.moving.motion == "servo" and self.arm == "none":
            raise FieldError(
                "motion", "servo", "a free-flying probe has no servos. Name an arm, or leave `motion` out."
            )
        self.case.check(self.organ)

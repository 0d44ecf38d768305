"""What can be asked for on the command line: pure data, in the units people type."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from mapping import InsetSettings, MapSettings
from planner import Planner, make_planner, planner_names
from sim.episode.scenario import GENERATED_LIVER, CodingName, MeshFrame, Scenario, Unit, load_scenario
from sim.errors import UsageError
from sim.world.motion.settings import MotionSettings, ServoSettings

from .organ_files import organ_changes
from .organ_pose import pose_changes

Frames = Literal["each", "last", "none"]
MotionKind = Literal["none", "kinematic", "servo"]
MapKept = Literal["always", "when-needed"]
PlanFor = Literal["tumours", "target"]
PATIENT_OPTIONS = (
    *("tumour", "organ_label", "tumour_label", "target", "target_label"),
    *("structure", "structure_label", "keepout", "keepout_label", "spacing_mm"),
)
"""Options that mean nothing without a patient's own files."""
PLANNERS = ", ".join(planner_names())


@dataclass(frozen=True, kw_only=True)
class EpisodeOptions:
    """Run one headless episode: sense, map, plan, move, until the steps are used up.

    Writes config.json, manifest.json, steps.csv, states.csv, summary.json, map.npz, figures and frames to the output
    folder as it goes; stopping it at any moment keeps what was done.
    """

    scenario: str = "liver"
    """sphere, spheres (the paper's synthetic organ with 1 or 3 tumours), liver, generated-liver (another for each
    seed), or the path of a scenario .toml."""
    planner: str = "find-and-outline"
    """Which planner chooses the next pose: find-and-outline, expected-improvement (the paper's), random,
    multi-resolution."""
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
    flange: str | None = None
    """Site of the arm that carries the probe; by default the first of flange and attachment_site that it has."""
    base_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the arm's base stands in the world [mm]; the table's top is z = 0."""
    base_yaw_deg: float = 0.0
    """How the base is turned about the vertical [degrees]."""
    motion: MotionKind = "kinematic"
    """How the arm gets from pose to pose: kinematic (along a timed, collision-free path), servo (the same path sent to
    simulated servos, the probe pressing on a compliant organ), none (it jumps; cheapest, the time is estimated)."""
    joint_speed: float | None = None
    """Speed limit of every joint [rad/s, slides m/s]. The published ones for the default arm, 1.0 for any other."""
    joint_acceleration: float | None = None
    """Acceleration limit of every joint [rad/s^2, slides m/s^2]. Published for the default arm, 4.0 for any other."""
    tip_speed_mm_s: float = 250.0
    """Speed limit of the probe's tip between poses [mm/s]."""
    approach_speed_mm_s: float = 50.0
    """Speed limit of the tip on its way to and from the organ [mm/s]."""
    press_mm: float = 2.0
    """With --motion servo: how far below the surface the tip is sent [mm]."""
    stiffness_n_m: float | None = None
    """With --motion servo: spring of the organ under the tip [N/m]; 87, healthy liver under the probe's face."""
    force_limit_n: float = 5.0
    """With --motion servo: contact force at which the arm stops and the run ends [N]."""
    sensing_s: float = 2.0
    """Modelled time of one sensing action [s], which adds to the procedure's."""
    organ: Path | None = None
    """Replace the scenario's organ by this mesh (STL, OBJ, PLY, GLB, glTF) or label volume (.nii, .nii.gz, .nrrd)."""
    tumour: tuple[Path, ...] = ()
    """Meshes or label volumes of the true tumours, in the organ's coordinates, besides those in the organ's volume."""
    n_tumours: int | None = None
    """Tumours to generate where no file holds any. The scenario's by default, with --organ none."""
    unit: Unit = "mm"
    """Unit of mesh files."""
    mesh_frame: MeshFrame = "auto"
    """Axes of mesh files: lps, ras, or auto for what the file's header says, else lps."""
    coding: CodingName = "auto"
    """What a label volume's numbers mean: lits, msd-liver, 3d-ircadb, totalsegmentator, or auto to tell from the
    labels."""
    organ_label: tuple[int, ...] = ()
    """Labels of the organ, in place of the coding's; tumours are added to it."""
    tumour_label: tuple[int, ...] = ()
    """Labels of tumours, in place of the coding's."""
    target: tuple[Path, ...] = ()
    """Meshes or label volumes of a second class, such as cysts, that is mapped beside the tumours."""
    target_label: tuple[int, ...] = ()
    """Labels of that class."""
    target_name: str | None = None
    """What to call it; target by default."""
    plan_for: PlanFor = "tumours"
    """Whose map the planner is shown, tumours or target; --until-sensed goes with it."""
    structure: tuple[Path, ...] = ()
    """Meshes or masks of vessels and other structures: shown, and measured to."""
    structure_label: tuple[int, ...] = ()
    """Labels of such structures."""
    keepout: tuple[Path, ...] = ()
    """Meshes or masks of structures near which the probe must not press."""
    keepout_label: tuple[int, ...] = ()
    """Labels of such structures."""
    keepout_mm: float = 5.0
    """How near [mm]."""
    spacing_mm: tuple[float, float, float] | None = None
    """Distances between a label volume's voxels [mm] in place of its header's, where that is wrong."""
    organ_pose: tuple[str, ...] = ()
    """How the organ lies; anterior up on the table by default. `best`: whichever way up brings the largest surface
    within the arm's reach. Three numbers: turned from anterior up about the world's x, y and z [degrees]. Seven:
    position [mm] and quaternion (wxyz) of the files' LPS axes in the world."""
    frames: Frames = "none"
    """Pictures of the scene: each (one per action), last (the final one), none."""
    report: bool = True
    """Write report.html, a page that shows the run from its first action to its last."""
    out: Path | None = None
    """Folder to write to; renders/<scenario>-<planner>-<seed> by default."""
    overwrite: bool = False
    """Replace a run that the folder already holds."""
    cone_half_angle_deg: float | None = None
    """Half-angle of the probe's cone [degrees]; the scenario's by default: 11.5, for the liver 15."""
    cone_depth_mm: float | None = None
    """Depth of the probe's cone [mm]; the scenario's by default: 102, for the liver 130."""
    map: MapKept = "always"
    """when-needed leaves the map out where the planner needs none: far faster, and only the share of the tumours
    sensed is scored."""
    map_form: Annotated[Literal["full", "diagonal"], tyro.conf.arg(name="map-form")] = "full"
    """full keeps the covariance of the map's weights, diagonal only their variances (faster, far worse)."""
    map_settings: Literal["paper", "calibrated"] | None = None
    """By default what the planner prefers: paper for expected-improvement and the baselines, else calibrated. paper is
    what the paper assumes, half of the organ tumour, under which expected improvement explores; calibrated expects 2
    per cent, and its probabilities mean what they say."""
    map_insets: Literal["on", "off"] | None = None
    """Finer maps laid in where tumour was sensed; by default on with calibrated settings and off with the paper's."""
    prior_prevalence: float | None = None
    """Share of the organ expected to be tumour before anything is sensed, in place of --map-settings'."""
    weight_variance: float | None = None
    """Prior variance of each of the map's weights, in place of --map-settings'."""
    em_iterations: int | None = None
    """Rounds of the variational bound within one reading."""
    travel_weight: float = 0.0
    """Of find-and-outline: how much a second of transfer counts against one of sensing. 0 asks for the fewest actions;
    docs/results.md has what more comes to."""
    batch: int = 1
    """Of find-and-outline: poses its search chooses together, taking the first on the shortest way through them."""
    sure_radius_mm: float = 8.0
    """Of find-and-outline: its confidence, and so --until-confident, speaks of tumours of this radius and more [mm]."""
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

    def __post_init__(self) -> None:
        """Validate what the parts below do not."""
        if not 1 <= self.steps <= 14_400:
            raise UsageError(f"--steps {self.steps}: from 1 to 14400.")
        if self.until_sensed is not None and not 0.0 < self.until_sensed <= 1.0:
            raise UsageError(f"--until-sensed {self.until_sensed}: above 0 and at most 1.")
        if self.until_confident is not None and not 0.0 < self.until_confident < 1.0:
            raise UsageError(f"--until-confident {self.until_confident}: between 0 and 1, both excluded.")
        if self.seed < 0:
            raise UsageError(f"--seed {self.seed}: 0 or more.")
        if self.planner not in planner_names():
            raise UsageError(f"--planner {self.planner}: choose one of {PLANNERS}.")
        if self.motion == "servo" and self.arm == "none":
            raise UsageError(
                "--motion servo: a free-flying probe has no servos. Name an arm, or leave --motion out."
            )
        for name in PATIENT_OPTIONS:
            if getattr(self, name) and self.organ is None:
                flag = name.replace("_", "-")
                raise UsageError(f"--{flag} goes with --organ, the file of the patient that it tells about.")

    def make_scenario(self) -> Scenario:
        """The scenario with what the command line changes about it."""
        scenario = load_scenario(self.scenario)
        changes: dict[str, Any] = pose_changes(self.organ_pose)
        if scenario.organ == GENERATED_LIVER and scenario.organ_seed is None:
            changes["organ_seed"] = self.seed
        if self.cone_half_angle_deg is not None:
            changes["cone_half_angle_rad"] = math.radians(self.cone_half_angle_deg)
        if self.cone_depth_mm is not None:
            changes["cone_depth_m"] = self.cone_depth_mm * 1e-3
        if self.n_tumours is not None:
            changes |= {"n_tumours": self.n_tumours, "tumour_load": "fixed"}
        if self.organ is not None:
            changes |= organ_changes(self, self.organ)
        if self.target_name is not None:
            changes["target_name"] = self.target_name
        scenario = dataclasses.replace(scenario, **changes)
        if self.plan_for == "target" and not scenario.has_target:
            raise UsageError(
                "--plan-for target: there is none. Give --target FILE or --target-label N, or leave it out."
            )
        return scenario

    def make_motion_settings(self) -> MotionSettings:
        """The motion's settings."""
        try:
            return MotionSettings(
                joint_speed=self.joint_speed,
                joint_acceleration=self.joint_acceleration,
                tip_speed_m_s=self.tip_speed_mm_s * 1e-3,
                approach_speed_m_s=self.approach_speed_mm_s * 1e-3,
                sensing_s=self.sensing_s,
            )
        except ValueError as error:
            raise UsageError(str(error)) from error

    def make_servo_settings(self) -> ServoSettings:
        """The simulated arm's settings."""
        changes = {} if self.stiffness_n_m is None else {"stiffness_n_m": self.stiffness_n_m}
        try:
            return ServoSettings(press_m=self.press_mm * 1e-3, force_limit_n=self.force_limit_n, **changes)
        except ValueError as error:
            raise UsageError(str(error)) from error

    def make_planner(self) -> Planner:
        """The planner with its options."""
        if self.planner == "find-and-outline":
            return make_planner(
                self.planner,
                travel_weight=self.travel_weight,
                batch=self.batch,
                sure_radius_m=self.sure_radius_mm * 1e-3,
            )
        if self.planner != "expected-improvement":
            return make_planner(self.planner)
        return make_planner(
            self.planner,
            values=self.ei_values,
            pose_rule=self.ei_pose_rule,
            threshold_rad=math.radians(self.ei_threshold_deg),
            exclusion_share=self.ei_exclusion_share,
            exclude_sensed=not self.ei_reuse_poses,
        )

    def check(self) -> None:
        """Nothing, if all parts can be made; called early, before much is built.

        Raises:
            UsageError, PlannerError: A value is out of range.
        """
        self.make_scenario()
        self.make_planner()
        self.make_map_settings()
        self.make_motion_settings()
        self.make_servo_settings()

    def keeps_map(self) -> bool:
        """Whether the episode keeps a map."""
        return self.map == "always" or self.make_planner().needs_belief

    def make_insets(self) -> InsetSettings | None:
        """Settings of the finer maps; None for none."""
        is_on = self._map_name() != "paper" if self.map_insets is None else self.map_insets == "on"
        return InsetSettings() if is_on else None

    def make_map_settings(self) -> MapSettings:
        """The map's settings."""
        settings = MapSettings.paper() if self._map_name() == "paper" else MapSettings()
        changes: dict[str, Any] = {
            "form": self.map_form,
            "prior_prevalence": self.prior_prevalence,
            "weight_variance": self.weight_variance,
            "n_em_iterations": self.em_iterations,
        }
        try:
            return dataclasses.replace(
                settings, **{name: value for name, value in changes.items() if value is not None}
            )
        except ValueError as error:
            raise UsageError(f"{error}.") from error

    def _map_name(self) -> str:
        return self.map_settings or self.make_planner().preferred_map

    def out_folder(self, scenario: Scenario) -> Path:
        """The folder asked for, or the one that names scenario, planner and seed."""
        return self.out or Path("renders") / f"{scenario.name}-{self.planner}-{self.seed}"

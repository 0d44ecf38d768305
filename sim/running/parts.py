"""The parts of an episode, made once from its configuration: scenario, planner, sensor, map, arm and motion."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mapping import DetailSettings, MapSettings, TrustSettings, TumourMapFactory, make_hilbert_map
from planner import (
    LesionPrior,
    Planner,
    PlannerError,
    confident_planner_names,
    make_planner,
    planner_class,
    planner_names,
    weighing_planner_names,
)
from sim.episode.scenario import GENERATED_LIVER, Scenario
from sim.episode.scenario_file import load_scenario
from sim.errors import FieldError, UsageError
from sim.plugs import PLANNER, parse_plug_options
from sim.world.motion.settings import MotionKind, MotionSettings, ServoSettings

from .case import MM, scenario_changes
from .config import ALWAYS, ULTRASOUND, WHEN_NEEDED, EpisodeConfig
from .own import own_map, own_plug, refuse_options
from .placing.arm_place import arm_of, probe_of
from .placing.body import body_of, motion_of
from .reader import reader_errors
from .sensor import sensor_of, trust_of
from .settings import detail_of, in_fields, map_settings_of, motion_settings_of, servo_settings_of, sweep_of

if TYPE_CHECKING:
    from sim.episode.body_options import BodyOptions
    from sim.episode.sweeping.settings import SweepSettings
    from sim.world.probes.probe import ProbeModel
    from sim.world.scene.arm import ArmModel
    from sim.world.sensing.sensor import Sensor

HAVE_FLAGS = ("find-and-outline", "expected-improvement")
"""Planners whose options are flags of their own; the others' are given as texts, as those of a user's own planner."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeParts:
    """Everything that decides an episode."""

    scenario: Scenario
    planner: Planner
    sensor: Sensor
    make_map: TumourMapFactory | None
    """Makes the map of the tumours, and that of a second class; None where no map is kept."""
    map_settings: MapSettings
    detail: DetailSettings | None
    """How the map answers in detail near sensed tumour; None for a plain Hilbert map."""
    trust: TrustSettings | None
    """How far labels are believed; None to take them as they are."""
    arm: ArmModel | None
    """The arm where it stands; None for a free-flying probe."""
    probe: ProbeModel
    motion: MotionKind
    motion_settings: MotionSettings
    servo_settings: ServoSettings
    sweep: SweepSettings | None
    """How the probe glides and reads on the way; None where it senses where it stops."""
    body: BodyOptions | None
    """How the organ's true place differs from the plan; None where it lies as planned."""
    seed: int
    n_steps: int
    """Largest number of sensing actions."""
    until_sensed: float | None
    """Share of the tumours sensed at which the episode ends; None for never."""
    until_confident: float | None
    """Confidence of the planner at which the episode ends; None for never."""
    miss_cost: float | None
    """How many actions a missed lesion is worth; the episode ends where more are not worth it. None for never."""
    plans_for_target: bool
    """Whether the planner is shown the map of a second class in place of the tumours'."""
    names: dict[str, Any]
    """What planner, arm and probe are called in summaries."""

    @property
    def stops(self) -> dict[str, Any]:
        """The rules by which the episode ends, as `Episode.steps` takes them."""
        return {
            "until_sensed": self.until_sensed,
            "until_confident": self.until_confident,
            "miss_cost": self.miss_cost,
        }

    @property
    def movement(self) -> tuple[MotionKind, MotionSettings, ServoSettings, SweepSettings | None]:
        """How the probe moves, as `motion_model_of` takes it."""
        return self.motion, self.motion_settings, self.servo_settings, self.sweep

    @property
    def asks_what_is_left(self) -> bool:
        """Whether the episode may end by what the planner takes to be left."""
        return self.until_confident is not None or self.miss_cost is not None

    @property
    def keeps_map(self) -> bool:
        """Whether a map is kept."""
        return self.make_map is not None


def make_parts(
    config: EpisodeConfig,
    *,
    scenario: Scenario | None = None,
    planner: Planner | None = None,
    sensor: Sensor | None = None,
    make_map: TumourMapFactory | None = None,
) -> EpisodeParts:
    """The parts that a configuration describes.

    Args:
        config: What to run.
        scenario: A scenario in place of the one that the configuration names.
        planner: A planner in its place. The map has the settings that it prefers, unless the configuration names them.
        sensor: A sensor in its place.
        make_map: What makes the map, in its place.

    Raises:
        UsageError, WorldError, PlannerError: Something cannot be made.
    """
    for name, thing in (("planner", planner), ("sensor", sensor)):
        if isinstance(thing, type):
            raise UsageError(
                f"`{name}`: {thing.__name__} is a class. Give an object of it, {thing.__name__}()."
            )
    planner = planner or planner_of(config)
    _check_stops(config, planner)
    settings = map_settings_of(config, planner)
    scenario = scenario_of(config, scenario)
    speeds = motion_settings_of(config)
    body = body_of(config.body, config.moving.motion, config.arm, speeds)
    trust = trust_of(config, scenario, sensor)
    return EpisodeParts(
        scenario=scenario,
        planner=planner,
        sensor=sensor or sensor_of(config),
        make_map=make_map or _map_of(config, planner),
        map_settings=settings,
        detail=detail_of(config, planner, trust, body, scenario.cone_depth_m),
        trust=trust,
        arm=arm_of(config),
        probe=probe_of(config),
        motion=motion_of(config.moving.motion, config.arm, config.body),
        motion_settings=speeds,
        servo_settings=servo_settings_of(config),
        sweep=sweep_of(config, body),
        body=body,
        seed=config.seed,
        n_steps=config.steps,
        until_sensed=config.until_sensed,
        until_confident=config.until_confident,
        miss_cost=config.miss_cost,
        plans_for_target=config.planning.plan_for == "target",
        names={"planner": config.planner, "arm": config.arm, "probe": config.probe},
    )


def check_config(config: EpisodeConfig) -> None:
    """Check that all parts but those that a user brings by text can be made; done early, before much is built.

    Raises:
        UsageError, PlannerError: A value is out of range.
    """
    scenario_of(config)
    body = body_of(config.body, config.moving.motion, config.arm, motion_settings_of(config))
    servo_settings_of(config)
    sweep_of(config, body)
    reader_errors(config.reading)
    if config.sensor == ULTRASOUND:
        sensor_of(config)
    if config.planner in planner_names():
        planner = planner_of(config)
        _check_stops(config, planner)
        map_settings_of(config, planner)


def scenario_of(config: EpisodeConfig, scenario: Scenario | None = None) -> Scenario:
    """The scenario with what the configuration changes about it.

    Args:
        config: What to run.
        scenario: A scenario in place of the one that the configuration names.

    Raises:
        UsageError: There is no such scenario, or a value is out of range.
    """
    scenario = scenario or load_scenario(config.scenario)
    changes = scenario_changes(config.organ, config.case, config.anatomy)
    if scenario.has_organ(GENERATED_LIVER) and scenario.organ_seed is None:
        changes["organ_seed"] = config.seed
    if config.sensing.cone_half_angle_deg is not None:
        changes["cone_half_angle_rad"] = math.radians(config.sensing.cone_half_angle_deg)
    if config.sensing.cone_depth_mm is not None:
        changes["cone_depth_m"] = config.sensing.cone_depth_mm * MM
    try:
        scenario = dataclasses.replace(scenario, **changes)
    except UsageError as error:
        raise in_fields(config, error) from error
    if config.planning.plan_for == "target" and not scenario.has_target:
        raise FieldError(
            "plan_for",
            "target",
            "there is no second class. Name its bodies with `target` or `target_label`, or leave it out.",
        )
    return scenario


def planner_of(config: EpisodeConfig) -> Planner:
    """The planner of a configuration, with its options.

    Raises:
        PlannerError, PlugError: The planner cannot be made.
    """
    if config.planner not in planner_names():
        return own_plug(config.planner, PLANNER, config.planning.planner_option)
    if config.planner in HAVE_FLAGS:
        refuse_options(
            "planner_option", config.planning.planner_option, f"planner of your own; {config.planner}"
        )
    try:
        return _named_planner(config)
    except PlannerError as error:
        raise in_fields(config, error) from error


def _named_planner(config: EpisodeConfig) -> Planner:
    if config.planner == "find-and-outline":
        own = config.find_and_outline
        return make_planner(
            config.planner,
            travel_weight=own.travel_weight,
            batch=own.batch,
            sure_radius_m=own.sure_radius_mm * MM,
            lesions=LesionPrior(
                mean_number=own.lesion_number,
                number_shape=own.lesion_number_shape,
                median_diameter_m=own.lesion_diameter_mm * MM,
                diameter_spread=own.lesion_diameter_spread,
            ),
        )
    if config.planner == "expected-improvement":
        ei = config.expected_improvement
        return make_planner(
            config.planner,
            values=ei.ei_values,
            pose_rule=ei.ei_pose_rule,
            threshold_rad=math.radians(ei.ei_threshold_deg),
            exclusion_share=ei.ei_exclusion_share,
            exclude_sensed=not ei.ei_reuse_poses,
        )
    return make_planner(config.planner, **parse_plug_options(config.planning.planner_option))


def _check_stops(config: EpisodeConfig, planner: Planner) -> None:
    """Refuse rules to stop by of which the planner tells nothing, since the run would never stop by them."""
    own = type(planner)
    name = next((each for each in planner_names() if planner_class(each) is own), own.__name__)
    if config.until_confident is not None and not planner.tells_confidence:
        raise FieldError(
            "until_confident",
            config.until_confident,
            f"the planner {name} does not tell how sure it is. "
            f"{_those(confident_planner_names())}, and so does one of your own that defines confidence.",
        )
    if config.miss_cost is not None and not planner.weighs_cost:
        raise FieldError(
            "miss_cost",
            config.miss_cost,
            f"the planner {name} does not weigh what more actions are worth. "
            f"{_those(weighing_planner_names())}, and so does one of your own that defines is_worth_going_on.",
        )


def _those(names: tuple[str, ...]) -> str:
    """Names, and that they do."""
    return f"{names[0]} does" if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]} do"


def _map_of(config: EpisodeConfig, planner: Planner) -> TumourMapFactory | None:
    """What makes the map; None where no map is kept."""
    kept = config.mapping.map
    if kept not in (ALWAYS, WHEN_NEEDED):
        return own_map(kept, config.mapping.map_option)
    refuse_options("map_option", config.mapping.map_option, "map of your own; the built-in map")
    is_kept = kept == ALWAYS or (kept == WHEN_NEEDED and planner.needs_belief)
    return make_hilbert_map if is_kept else None

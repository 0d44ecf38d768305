"""The settings of an episode's parts from its configuration, and errors of parts in the fields that people set."""

from __future__ import annotations

import dataclasses
import re
from typing import TYPE_CHECKING, Any, get_args

from mapping import DetailSettings, MapSettings, TrustSettings
from planner import Planner
from sim.errors import FieldError, UsageError
from sim.world.motion.settings import MotionSettings, ServoSettings

from .case import MM
from .config import EpisodeConfig, MapName, MovingConfig
from .fields import value_of
from .placing.body import DEFAULT_PRESS_N, motion_of
from .sweep import sweep_settings

if TYPE_CHECKING:
    from sim.episode.body_options import BodyOptions
    from sim.episode.sweeping.settings import SweepSettings

FIELD_OF = {
    "sure_radius_m": "sure_radius_mm",
    "mean_number": "lesion_number",
    "number_shape": "lesion_number_shape",
    "median_diameter_m": "lesion_diameter_mm",
    "diameter_spread": "lesion_diameter_spread",
    "threshold_rad": "ei_threshold_deg",
    "exclusion_share": "ei_exclusion_share",
    "travel_weight": "travel_weight",
    "batch": "batch",
    "n_em_iterations": "em_iterations",
    "prior_prevalence": "prior_prevalence",
    "weight_variance": "weight_variance",
    "false_positive_rate": "false_positive_rate",
    "tip_speed_m_s": "tip_speed_mm_s",
    "approach_speed_m_s": "approach_speed_mm_s",
    "joint_speed": "joint_speed",
    "joint_acceleration": "joint_acceleration",
    "sensing_s": "sensing_s",
    "press_m": "press_mm",
    "stiffness_n_m": "stiffness_n_m",
    "force_limit_n": "force_limit_n",
    "cone half-angle": "cone_half_angle_deg",
    "cone_depth_m": "cone_depth_mm",
    "n_tumours": "n_tumours",
    "keepout_distance_m": "keepout_mm",
    "voxel_spacing_m": "spacing_mm",
}
"""The field that people set, by the setting of a part that it becomes, for errors."""


def map_settings_of(config: EpisodeConfig, planner: Planner) -> MapSettings:
    """The map's settings: those that the planner prefers, unless the configuration names them.

    Raises:
        UsageError: A value is out of range.
    """
    own = config.mapping
    settings = MapSettings.paper() if _map_name(config, planner) == "paper" else MapSettings()
    changes: dict[str, Any] = {
        "form": own.map_form,
        "prior_prevalence": own.prior_prevalence,
        "weight_variance": own.weight_variance,
        "n_em_iterations": own.em_iterations,
        "false_positive_rate": own.false_positive_rate,
        "false_negative_rate": own.false_negative_rate,
    }
    try:
        return dataclasses.replace(
            settings, **{name: value for name, value in changes.items() if value is not None}
        )
    except ValueError as error:
        raise in_fields(config, error) from error


def detail_of(
    config: EpisodeConfig,
    planner: Planner,
    trust: TrustSettings | None,
    body: BodyOptions | None,
    depth_m: float,
) -> DetailSettings | None:
    """How the map answers in detail near sensed tumour; None for a plain Hilbert map.

    Args:
        config: What to run.
        planner: Prefers some settings.
        trust: How far labels are trusted; where they are not, more of them answer for a place.
        body: What may be wrong about the body, and what is believed of it; None for a rigid organ in its known place.
        depth_m: How deep a view reaches [m].
    """
    wanted = config.mapping.map_detail
    is_on = _map_name(config, planner) != "paper" if wanted is None else wanted == "on"
    if not is_on:
        return None
    off_m = 0.0 if body is None else body.place_deviation_m(depth_m)
    force_n = body.press_n if body is not None and body.yields else 0.0
    settings = DetailSettings() if trust is None else DetailSettings.of_many_labels()
    settings = settings.where_views_are_off(off_m, force_n, counts_views=trust is not None)
    return settings if off_m == 0.0 else settings.at_uncertain_places(off_m)


def motion_settings_of(config: EpisodeConfig) -> MotionSettings:
    """The speeds and times of the motion.

    Raises:
        UsageError: A value is out of range.
    """
    own = config.moving
    try:
        return MotionSettings(
            joint_speed=own.joint_speed,
            joint_acceleration=own.joint_acceleration,
            tip_speed_m_s=own.tip_speed_mm_s * MM,
            approach_speed_m_s=own.approach_speed_mm_s * MM,
            sensing_s=own.sensing_s,
        )
    except ValueError as error:
        raise in_fields(config, error) from error


def servo_settings_of(config: EpisodeConfig) -> ServoSettings:
    """The settings of the simulated arm.

    Raises:
        UsageError: A value is out of range.
    """
    own, body = config.moving, config.body
    is_elastic, press_n = body.tissue == "elastic", None
    if motion_of(own.motion, config.arm, body) == "servo":
        _check_pressed_once(config)
        press_n = DEFAULT_PRESS_N if is_elastic and body.press_n is None else body.press_n
    try:
        settings = ServoSettings(
            press_m=own.press_mm * MM,
            press_n=press_n,
            force_limit_n=own.force_limit_n,
            stiffness_n_m=own.stiffness_n_m,
        )
    except ValueError as error:
        raise in_fields(config, error) from error
    # Elastic tissue has the force of its own, which no spring has to bear.
    return dataclasses.replace(settings, press_n=None) if is_elastic else settings


def sweep_of(config: EpisodeConfig, body: BodyOptions | None) -> SweepSettings | None:
    """How the probe glides and reads on the way; None where it senses where it stops.

    Raises:
        FieldError: A value is out of range, or options do not go together.
    """
    motion, press_n = motion_of(config.moving.motion, config.arm, config.body), config.body.press_n
    return sweep_settings(
        config.sweeping, motion=motion, press_n=press_n, sensor=config.sensor, body=config.body
    )


def _check_pressed_once(config: EpisodeConfig) -> None:
    """Check that no option of servos is given that another makes mean nothing.

    Raises:
        FieldError: One is; it is named, and so is the other.
    """
    is_elastic, plain = config.body.tissue == "elastic", MovingConfig()
    if config.moving.press_mm != plain.press_mm and (is_elastic or config.body.press_n is not None):
        raise FieldError(
            "press_mm",
            config.moving.press_mm,
            "means nothing where the probe stops at a force (`press_n`); leave it out.",
        )
    if config.moving.stiffness_n_m is not None and is_elastic:
        raise FieldError(
            "stiffness_n_m",
            config.moving.stiffness_n_m,
            "means nothing with `tissue` elastic, whose stiffness follows from `young_kpa`; leave it out.",
        )


def _map_name(config: EpisodeConfig, planner: Planner) -> str:
    name = config.mapping.map_settings or planner.preferred_map
    if name not in get_args(MapName):
        raise UsageError(
            f"{type(planner).__name__}.preferred_map is {name!r}; it must be {' or '.join(get_args(MapName))}."
        )
    return name


def in_fields(config: EpisodeConfig, error: Exception) -> Exception:
    """An error of a part that names the part's own setting, as one that names the field that people set."""
    for part, field in FIELD_OF.items():
        if re.search(rf"(?<!\w){part}(?!\w)", str(error)):
            value = value_of(config, field)
            return FieldError(field, value, f"{in_units_of(field, part, str(error)).rstrip('.')}.")
    return UsageError(f"{str(error).rstrip('.')}.")


def in_units_of(field: str, part: str, text: str) -> str:
    """The text of an error about a part's setting, with its range in the unit of the field and without its value.

    Args:
        field: The field that people set.
        part: The name of the part's setting.
        text: What the part says, in SI units.
    """
    text = re.sub(rf"^`?{part}`?(=[^:]*:)?\s*|,? got -?[\d.einf+-]+", "", text)
    text = re.sub(r"^(cone half-angle )?-?[\d.e+-]+ degrees: ", "", text)
    if not text.startswith("must"):
        text = f"must be {text}"
    if field.endswith("_mm"):
        return re.sub(r"from ([\d.]+) to ([\d.]+) m\b", _in_millimetres, text)
    if field.endswith("_deg"):
        return text.replace("0 and pi", "0 and 180 degrees")
    return text


def _in_millimetres(found: re.Match[str]) -> str:
    return "from {:g} to {:g} mm".format(*(float(each) / MM for each in found.groups()))

"""The sensor of a configuration, and how far its labels are trusted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mapping import TrustSettings
from planner import Cone
from sim.episode.scenario import Scenario
from sim.plugs import SENSOR

from .config import CONE, CONE_WITH_ERRORS, SENSORS, EpisodeConfig
from .own import own_plug, refuse_options
from .reader import check_no_reader, reader_errors, trust_settings

if TYPE_CHECKING:
    from sim.world.sensing.sensor import Sensor


def sensor_of(config: EpisodeConfig) -> Sensor:
    """The sensor of a configuration, with its options.

    Raises:
        PlugError, FieldError: The sensor cannot be made.
    """
    if config.sensor not in SENSORS:
        check_no_reader(config.reading, config.sensor)
        return own_plug(config.sensor, SENSOR, config.sensing.sensor_option)
    refuse_options("sensor_option", config.sensing.sensor_option, f"sensor of your own; {config.sensor}")
    if config.sensor == CONE:
        from sim.world.sensing.cone_sensor import ConeSensor

        check_no_reader(config.reading, config.sensor)
        return ConeSensor()
    from sim.world.sensing.errors.erring_sensor import ErringSensor

    return ErringSensor(errors=reader_errors(config.reading), shadowing=config.reading.shadowing)


def trust_of(config: EpisodeConfig, scenario: Scenario, sensor: Sensor | None) -> TrustSettings | None:
    """How far labels are trusted; None where they are taken as they are.

    Args:
        config: What to run.
        scenario: Gives the cone.
        sensor: A sensor in place of the one that the configuration names, of whose errors nothing is known.

    Raises:
        FieldError: Rates are to be told of a sensor that tells none.
    """
    cone = Cone(half_angle_rad=scenario.cone_half_angle_rad, depth_m=scenario.cone_depth_m)
    return trust_settings(config.reading, cone, errs=sensor is None and config.sensor == CONE_WITH_ERRORS)

"""The sensor of a configuration, and how far its labels are trusted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mapping import TrustSettings
from planner import Cone
from sim.episode.scenario import Scenario
from sim.plugs import SENSOR

from .config import CONE_WITH_ERRORS, SENSORS, ULTRASOUND, EpisodeConfig
from .own import own_plug, refuse_options
from .reader import (
    IMAGE,
    check_image_reader,
    check_no_reader,
    has_reader,
    label_trust_of,
    reader_errors,
    trust_settings,
)
from .ultrasound import ultrasound_sensor_of

if TYPE_CHECKING:
    from sim.world.sensing.image_reader.image_reader import ImageReader
    from sim.world.sensing.sensor import Sensor


def sensor_of(config: EpisodeConfig) -> Sensor:
    """The sensor of a configuration, with its options.

    Raises:
        PlugError, FieldError: The sensor cannot be made.
    """
    reader = image_reader_of(config)
    if config.sensor not in SENSORS:
        check_no_reader(config.reading, config.sensor)
        return own_plug(config.sensor, SENSOR, config.sensing.sensor_option)
    from sim.world.sensing.cone_sensor import ConeSensor

    refuse_options("sensor_option", config.sensing.sensor_option, f"sensor of your own; {config.sensor}")
    if reader is not None:
        from sim.world.sensing.image_reader.reading_sensor import ReadingSensor

        ultrasound = ultrasound_sensor_of(config.ultrasound)
        tells_doubt = label_trust_of(config.reading, errs=True) == "told"
        return ReadingSensor(ultrasound=ultrasound, reader=reader, tells_doubt=tells_doubt)
    exact: Sensor = ConeSensor()
    if config.sensor == ULTRASOUND:
        exact = ultrasound_sensor_of(config.ultrasound)
    if not reader_errs(config):
        check_no_reader(config.reading, config.sensor)
        return exact
    from sim.world.sensing.errors.erring_sensor import ErringSensor

    return ErringSensor(errors=reader_errors(config.reading), exact=exact, shadowing=config.reading.shadowing)


def image_reader_of(config: EpisodeConfig) -> ImageReader | None:
    """The reader of images; None where another is chosen.

    Raises:
        FieldError: Its options do not go together, or its weights cannot be used.
        MissingPackageError: numba is not installed.
    """
    check_image_reader(config.reading, config.sensor, ULTRASOUND)
    if config.reading.reader != IMAGE:
        return None
    from sim.world.sensing.image_reader.image_reader import ImageReader
    from sim.world.sensing.image_reader.weights import load_weights

    return ImageReader(weights=load_weights(config.reading.reader_weights))


def reader_errs(config: EpisodeConfig) -> bool:
    """Whether the sensor is one whose reader errs: cone-with-errors, or pictures with the options of a reader."""
    if config.sensor == ULTRASOUND:
        return has_reader(config.reading)
    return config.sensor == CONE_WITH_ERRORS


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
    return trust_settings(config.reading, cone, errs=sensor is None and reader_errs(config))

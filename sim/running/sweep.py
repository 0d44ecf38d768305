"""Sensing along the way: options of a sweep, and what they become."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sim.errors import FieldError

from .case import MM
from .placing.body import NOT_AS_PLANNED

if TYPE_CHECKING:
    from sim.episode.moving.motion import MotionModel
    from sim.episode.setup import Setup
    from sim.episode.sweeping.settings import SweepSettings
    from sim.world.motion.settings import MotionKind, MotionSettings, ServoSettings

    from .placing.body import BodyConfig

Sense = Literal["stop", "sweep"]
STOP, SWEEP = "stop", "sweep"


@dataclass(frozen=True, kw_only=True)
class SweepConfig:
    """Whether the probe senses where it stops, or along its way over the organ."""

    sense: Sense = STOP
    """When readings are taken: stop (the probe is lifted, comes down and senses where it stands) or sweep (it glides
    over the organ and senses on the way, and is lifted only where it must)."""
    read_every_mm: float = 10.0
    """In a sweep, way of the tip from one reading to the next [mm]."""
    frame_rate_hz: float = 10.0
    """In a sweep, readings that the sensor makes in a second at most."""
    sweep_speed_mm_s: float = 40.0
    """In a sweep, speed limit of the tip on the organ [mm/s]."""
    sweep_tilt_deg: float = 15.0
    """In a sweep, how far the beam may be from the surface's normal at most [degrees]."""


_RANGES = {
    "read_every_mm": (0.5, 200.0),
    "frame_rate_hz": (0.1, 1000.0),
    "sweep_speed_mm_s": (1.0, 250.0),
    "sweep_tilt_deg": (0.1, 45.0),
}


def sweep_settings(
    own: SweepConfig, *, motion: MotionKind, press_n: float | None, sensor: str, body: BodyConfig
) -> SweepSettings | None:
    """How the probe glides and reads; None where it senses where it stops.

    Args:
        own: The options.
        motion: How the probe moves.
        press_n: Force of the probe on the organ [N]; None where none is named.
        sensor: The sensor's name.
        body: Whether and how the organ's true place differs from the plan.

    Raises:
        FieldError: A value is out of range, or an option does not go together with a sweep, or means nothing without.
    """
    plain = SweepConfig()
    if own.sense == STOP:
        for name in _RANGES:
            if (value := getattr(own, name)) != getattr(plain, name):
                raise FieldError(name, value, "means nothing without `sense` sweep; give both, or neither.")
        return None
    for name, (low, high) in _RANGES.items():
        if not low <= (value := getattr(own, name)) <= high:
            raise FieldError(name, value, f"must be from {low:g} to {high:g}.")
    _check_company(sensor, body)
    if motion == "servo" and press_n is None:
        raise FieldError(
            "motion", motion, "holds a force in a sweep. Name it (`press_n`), or choose another motion."
        )
    wanted_hz = own.sweep_speed_mm_s / own.read_every_mm
    if wanted_hz > own.frame_rate_hz:
        raise FieldError(
            "read_every_mm",
            own.read_every_mm,
            f"at {own.sweep_speed_mm_s:g} mm/s that is {wanted_hz:.3g} readings a second, and the sensor makes "
            f"{own.frame_rate_hz:g}. Read less often, glide more slowly (`sweep_speed_mm_s`), or name a faster sensor "
            "(`frame_rate_hz`).",
        )
    from sim.episode.sweeping.settings import SweepSettings

    return SweepSettings(
        speed_m_s=own.sweep_speed_mm_s * MM,
        read_every_m=own.read_every_mm * MM,
        frame_rate_hz=own.frame_rate_hz,
        most_tilt_rad=math.radians(own.sweep_tilt_deg),
    )


def _check_company(sensor: str, body: BodyConfig) -> None:
    """Check that nothing else is wanted that a sweep cannot do.

    Raises:
        FieldError: Something is.
    """
    if sensor == "ultrasound":
        raise FieldError(
            "sensor", sensor, "tilts the probe for each reading. Choose another sensor with `sense` sweep."
        )
    for name in NOT_AS_PLANNED:
        if (value := getattr(body, name)) != getattr(type(body)(), name):
            raise FieldError(
                name,
                value,
                f"does not go with `sense` {SWEEP}, which takes the organ to be rigid and to lie where it was planned. "
                "Leave one of them out.",
            )


def motion_model_of(
    setup: Setup, kind: MotionKind, speeds: MotionSettings, servo: ServoSettings, sweep: SweepSettings | None
) -> MotionModel:
    """A fresh motion model for one episode on a setup.

    Args:
        setup: The setup.
        kind: How the arm moves.
        speeds: How fast.
        servo: Stiffnesses and the force limit, which only servos need.
        sweep: How the probe glides and reads on the way; None where it senses where it stops.
    """
    from sim.episode.moving.arm_motion import make_motion_model
    from sim.episode.sweeping.ground import ground_of
    from sim.episode.sweeping.making import make_sweep_motion

    if sweep is None:
        return make_motion_model(setup, kind, speeds, servo)
    return make_sweep_motion(ground_of(setup), kind, sweep, speeds, servo)

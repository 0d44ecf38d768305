"""The arm of a configuration, at a place that people tell in millimetres and degrees, and the probe that it carries."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from sim.errors import FieldError

from ..case import MM, metres
from ..config import DEFAULT_PROBE, EpisodeConfig

if TYPE_CHECKING:
    from sim.world.probes.probe import ProbeModel
    from sim.world.scene.arm import ArmModel

MAX_POSITION_MM = 10_000.0
"""A position that is farther than this from the world's origin is a mistake of unit."""
MAX_PADDING_MM = 30.0
"""The distance to the organ is known this far around it and farther."""
METRES_MM = 3.0
"""A position whose numbers are all below this was likely given in metres."""


def arm_of(config: EpisodeConfig) -> ArmModel | None:
    """The arm of a configuration, where it stands; None for a free-flying probe.

    Raises:
        UsageError, WorldError: The base cannot stand there, or the arm's package is not installed.
    """
    if config.arm == "none":
        return None
    own = config.mounting
    return arm_standing(config.arm, own.flange, base_mm=own.base_mm, base_yaw_deg=own.base_yaw_deg)


def probe_of(config: EpisodeConfig) -> ProbeModel:
    """The probe of a configuration.

    Raises:
        WorldError: There is no such probe.
    """
    from sim.world.probes.probe import named_probe

    return named_probe(config.probe)


def arm_standing(
    arm: str, flange: str | None, *, base_mm: tuple[float, float, float], base_yaw_deg: float
) -> ArmModel:
    """The arm of a name or file, with its base at a place in millimetres and degrees.

    Raises:
        UsageError: A number is not finite or too large, or the position was likely given in metres.
        WorldError: There is no such arm.
    """
    from sim.world.scene.named_arms import named_arm

    check_base(base_mm, base_yaw_deg)
    return named_arm(arm, flange, base_m=metres(base_mm), base_yaw_rad=math.radians(base_yaw_deg))


def check_base(base_mm: tuple[float, float, float], base_yaw_deg: float) -> None:
    """Check that a base can stand at a place.

    Raises:
        FieldError: A number is not finite or too large, or the position was likely given in metres.
    """
    shown = tuple(f"{value:g}" for value in base_mm)
    if not all(math.isfinite(value) and abs(value) <= MAX_POSITION_MM for value in base_mm):
        raise FieldError("base_mm", shown, f"must be finite numbers of at most {MAX_POSITION_MM:.0f} mm.")
    if 0.0 < max(abs(value) for value in base_mm) < METRES_MM:
        raise FieldError("base_mm", shown, f"is below {METRES_MM:g} mm; was it given in metres?")
    if not math.isfinite(base_yaw_deg) or abs(base_yaw_deg) > 360.0:
        raise FieldError("base_yaw_deg", f"{base_yaw_deg:g}", "must be from -360 to 360 degrees.")


def check_padding(padding_mm: float) -> None:
    """Check that the arm can keep a padding.

    Raises:
        FieldError: It is out of range.
    """
    if not 0.0 <= padding_mm <= MAX_PADDING_MM:
        raise FieldError("padding_mm", f"{padding_mm:g}", f"must be from 0 to {MAX_PADDING_MM:g} mm.")


def arm_fields(arm: ArmModel | str) -> dict[str, Any]:
    """The fields of a configuration that name an arm and where it stands, by name."""
    if isinstance(arm, str):
        return {"arm": arm}
    return {
        "arm": str(arm.path),
        "flange": arm.flange,
        "base_mm": tuple(each / MM for each in arm.base_m),
        "base_yaw_deg": math.degrees(arm.base_yaw_rad),
    }


def probe_text(probe: ProbeModel | str) -> str:
    """The text that names a probe in a configuration."""
    if isinstance(probe, str):
        return probe
    return DEFAULT_PROBE if probe.path is None else str(probe.path)

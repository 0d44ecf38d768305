"""Where the organ truly is, and what is made of that: options, and what they become."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sim.errors import FieldError
from sim.world.motion.settings import MotionKind, MotionSettings

from ..case import MM

if TYPE_CHECKING:
    from sim.episode.body_options import BodyOptions
    from sim.world.tissue.settings import ElasticSettings

Registration = Literal["contacts", "none"]
Tissue = Literal["rigid", "elastic"]
DEFAULT_PRESS_N = 1.0
"""Force at which the probe stops on elastic tissue [N]."""

NOT_AS_PLANNED = (
    *("registration_mm", "registration_deg", "tracking_mm", "tracking_deg", "breathing_mm"),
    "tissue",
)
"""Options by which the organ does not lie still and rigid where it was planned, or the tip not where it is measured."""


@dataclass(frozen=True, kw_only=True)
class BodyConfig:
    """A body that is not quite where the plan says, that breathes, and a probe that is not measured exactly."""

    registration_mm: float = 0.0
    """How far the organ truly lies from where it was planned, in a direction drawn by the seed [mm]."""
    registration_deg: float = 0.0
    """By how much it is turned about its middle, about an axis drawn by the seed [degrees]."""
    tracking_mm: float = 0.0
    """Standard deviation, along each axis, of where the tip is measured about where it is [mm]."""
    tracking_deg: float = 0.0
    """Standard deviation, about each axis, of the measured turn of the tip about the true one [degrees]."""
    breathing_mm: float = 0.0
    """How far the organ is moved at full inhale from where it rests at exhale [mm]."""
    breathing_s: float = 4.0
    """Seconds of a breath."""
    breathing_axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Direction of that motion in the world."""
    gating: bool = False
    """Wait at each pose for the rest at exhale before sensing."""
    contact_search_mm: float = 30.0
    """How far below the expected surface the probe goes on to look for contact [mm]."""
    tissue: Tissue = "rigid"
    """Whether the organ yields under the probe: rigid or elastic."""
    press_n: float | None = None
    """Force at which the probe stops [N]; by default 1 on elastic tissue, and in servo motion `press_mm` counts. On a
    rigid organ an arm takes servo motion for it. Tissue of 5 kPa bears 5 under the embedded probe."""
    young_kpa: float = 5.0
    """Young's modulus of elastic tissue [kPa]; healthy liver has 4 to 6."""
    tumour_young_kpa: float = 50.0
    """Young's modulus of the tumours in it [kPa]."""
    register: Registration = "contacts"
    """What tells where the organ lies: contacts (the belief is learnt from where the probe meets the surface) or none
    (the plan is believed)."""
    align_readings: bool = True
    """Where the tip is measured with an error and contacts are believed, move each reading across its beam to where its
    labels fit those of the others."""
    register_above_mm: float | None = None
    """Spend actions on registering, where a contact tells most of the place, as long as the organ is believed to be off
    by more than this [mm]; by default none is."""


def motion_of(motion: MotionKind, arm: str, body: BodyConfig) -> MotionKind:
    """How the probe moves: an arm that is to press with a force on a rigid organ has its servos hold that.

    Args:
        motion: What was asked for; kinematic motion presses on elastic tissue alone.
        arm: The arm's name, or none.
        body: The force and the tissue.
    """
    is_pressing = body.press_n is not None and body.tissue == "rigid" and arm != "none"
    return "servo" if is_pressing and motion == "kinematic" else motion


def body_of(config: BodyConfig, motion: MotionKind, arm: str, speeds: MotionSettings) -> BodyOptions | None:
    """How the true world differs from the plan; None where it does not.

    Args:
        config: The options.
        motion: How the probe is to move.
        arm: The arm's name, or none.
        speeds: How fast it moves.

    Raises:
        FieldError: A value is out of range.
    """
    from sim.episode.body_options import BodyOptions
    from sim.world.body.settings import BodySettings

    settings = BodySettings(
        registration_m=config.registration_mm * MM,
        registration_rad=math.radians(config.registration_deg),
        tracking_m=config.tracking_mm * MM,
        tracking_rad=math.radians(config.tracking_deg),
        breathing_m=config.breathing_mm * MM,
        breathing_s=config.breathing_s,
        breathing_axis=config.breathing_axis,
        is_gated=config.gating,
        contact_search_m=config.contact_search_mm * MM,
    )
    tissue = _tissue(config)
    _check_used(config, motion_of(motion, arm, config))
    is_as_planned = settings.is_as_planned and tissue is None
    _check_registering(config, is_as_planned=is_as_planned)
    if is_as_planned:
        return None
    press_n = DEFAULT_PRESS_N if config.press_n is None else config.press_n
    above_mm = config.register_above_mm
    return BodyOptions(
        settings=settings,
        registration=config.register,
        aligns_readings=config.align_readings,
        tissue=tissue,
        press_n=press_n,
        motion=speeds,
        register_above_m=math.inf if above_mm is None else above_mm * MM,
    )


def _tissue(config: BodyConfig) -> ElasticSettings | None:
    """What elastic tissue is made of; None of rigid tissue.

    Raises:
        FieldError: A value is out of range.
    """
    from sim.world.tissue.settings import ElasticSettings

    ranges = (("press_n", 0.01, 50.0), ("young_kpa", 0.1, 1e5), ("tumour_young_kpa", 0.1, 1e5))
    for name, low, high in ranges:
        value = getattr(config, name)
        if value is not None and not low <= value <= high:
            raise FieldError(name, value, f"must be from {low:g} to {high:g}.")
    if config.tissue == "rigid":
        return None
    return ElasticSettings(
        youngs_modulus_pa=config.young_kpa * 1e3, tumour_youngs_modulus_pa=config.tumour_young_kpa * 1e3
    )


_ONLY_WITH = {
    "press_n": "tissue",
    "young_kpa": "tissue",
    "tumour_young_kpa": "tissue",
    "breathing_s": "breathing_mm",
    "breathing_axis": "breathing_mm",
    "gating": "breathing_mm",
}
"""Options that mean nothing without another."""


def _check_used(config: BodyConfig, motion: MotionKind) -> None:
    """Check that no option is given that means nothing.

    Raises:
        FieldError: One is; it is named, and so is what it lacks.
    """
    plain = BodyConfig()
    for name, other in _ONLY_WITH.items():
        if name == "press_n" and motion == "servo":
            continue
        if getattr(config, name) != getattr(plain, name) and getattr(config, other) == getattr(plain, other):
            lacks = "`tissue` elastic" if other == "tissue" else f"`{other}` above 0"
            lacks += " or `motion` servo" if name == "press_n" else ""
            raise FieldError(
                name, getattr(config, name), f"means nothing without {lacks}; give both, or neither."
            )


def _check_registering(config: BodyConfig, *, is_as_planned: bool) -> None:
    """Check that readings are aligned, and actions spent on registering, only where that can tell anything.

    Raises:
        FieldError: They are where it cannot, or actions are from a deviation on that is none.
    """
    if not config.align_readings and (
        config.tracking_mm == config.tracking_deg == 0.0 or config.register == "none"
    ):
        lacks = "an error of the tip (`tracking_mm`), and `register` contacts"
        raise FieldError("align_readings", False, f"means nothing without {lacks}; leave it out.")
    above_mm = config.register_above_mm
    if above_mm is None:
        return
    if not (math.isfinite(above_mm) and above_mm > 0.0):
        raise FieldError("register_above_mm", above_mm, "must be above 0 and finite.")
    if is_as_planned or config.register == "none":
        lacks = "an organ that is not as planned, by `registration_mm` or another of these"
        lacks = "`register` contacts" if config.register == "none" else lacks
        raise FieldError(
            "register_above_mm", above_mm, f"means nothing without {lacks}; give both, or neither."
        )

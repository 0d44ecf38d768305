"""The options of the sensor `ultrasound`, and the sensor that they describe."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim.errors import FieldError
from sim.world.sensing.sweep import KeptPlanes

from .case import MM

if TYPE_CHECKING:
    from sim.world.sensing.ultrasound.convex_array import ConvexArray
    from sim.world.sensing.ultrasound.settings import Settings
    from sim.world.sensing.ultrasound.ultrasound_sensor import UltrasoundSensor


@dataclass(frozen=True, kw_only=True)
class UltrasoundConfig:
    """Options of the sensor ultrasound."""

    planes: int = 16
    """Planes of a sweep, which are rocked about the contact."""
    sweep_half_angle_deg: float | None = None
    """Angle of the sweep's first and last plane to the beam [degrees]; by default the half-angle of the cone."""
    sweep_points: int = 1500
    """Points on all planes together, of which a reading has those that were seen and lie in the organ."""
    array_width_mm: float = 25.0
    """Width of the array's face, which touches the organ with its middle [mm]."""
    array_radius_mm: float = 25.0
    """Radius of curvature of the face [mm]; with the width it gives the angle of the picture, 60 degrees."""
    image_depth_mm: float | None = None
    """Depth of the pictures [mm]; by default that of the cone."""
    frequency_mhz: float = 3.5
    """Centre frequency of the pulse [MHz]. Higher ones resolve more and reach less deep."""
    focus_mm: float = 65.0
    """Depth at which the transmitted beam is focused [mm]."""
    gain_db: float = 0.0
    """Gain of the pictures [dB]."""
    tgc_db_cm_mhz: float = 0.5
    """Attenuation that the time-gain compensation makes up for [dB/cm/MHz]; by default that of liver."""
    dynamic_range_db: float = 60.0
    """How far below white black begins in the pictures [dB]."""
    seen_db: float = 60.0
    """Points are seen down to this loss on the way there and back [dB]."""
    shadow_db: float = 20.0
    """Points lie in a shadow where more than this is lost beyond what the time-gain compensation makes up for [dB]."""
    organ_tissue: str = "liver"
    """Tissue of the organ; docs/sensing.md has the table of tissues."""
    tumour_tissue: str = "hypoechoic"
    """Tissue of the tumours: hypoechoic, isoechoic, hyperechoic, or another of the table; or by-lesion, where each has
    a look of its own, drawn once by the shares in docs/readers.md."""
    target_tissue: str = "hyperechoic"
    """Tissue of the bodies of a second class."""
    surroundings_tissue: str = "fat"
    """Tissue about the organ, where no structure lies."""
    structure_tissue: tuple[str, ...] = ()
    """Tissues of structures as name=tissue. By default a structure's name tells: a vessel is blood, a rib bone, and
    what tells nothing is soft tissue."""
    tissue_spacing_mm: float = 1.0
    """Distance of the nodes of the grid of tissues, which is cut once an episode [mm]."""
    image_pixels: int = 512
    """Pixels along each edge of a picture."""
    keep_images: KeptPlanes = "middle"
    """Pictures of a sweep that the run's folder keeps: middle (one an action), all, or none."""


def ultrasound_sensor_of(own: UltrasoundConfig) -> UltrasoundSensor:
    """The sensor that options describe.

    Raises:
        FieldError: A value is out of range.
        MissingPackageError: numba is not installed.
    """
    for name, low, high in RANGES:
        value = getattr(own, name)
        if value is not None and not low <= value <= high:
            raise FieldError(name, value, f"must be from {low:g} to {high:g}.")
    try:
        return _sensor(own)
    except FieldError as error:
        field = FIELD_OF.get(error.field, error.field)
        raise FieldError(field, getattr(own, field), error.problem) from error


def _sensor(own: UltrasoundConfig) -> UltrasoundSensor:
    """The sensor; errors name the settings of its parts."""
    from sim.world.sensing.ultrasound.ultrasound_sensor import TissueChoice, UltrasoundSensor

    half_deg = own.sweep_half_angle_deg
    return UltrasoundSensor(
        array=_array(own),
        settings=_settings(own),
        tissues=TissueChoice(
            organ=own.organ_tissue,
            tumour=own.tumour_tissue,
            target=own.target_tissue,
            surroundings=own.surroundings_tissue,
            structures=tuple(_pair(text) for text in own.structure_tissue),
        ),
        has_own_depth=own.image_depth_mm is not None,
        n_planes=own.planes,
        half_sweep_rad=None if half_deg is None else math.radians(half_deg),
        n_points=own.sweep_points,
        seen_db=own.seen_db,
        shadow_db=own.shadow_db,
        tissue_spacing_m=own.tissue_spacing_mm * MM,
    )


def _array(own: UltrasoundConfig) -> ConvexArray:
    from sim.world.sensing.ultrasound.convex_array import ConvexArray

    array = ConvexArray(
        face_width_m=own.array_width_mm * MM,
        radius_m=own.array_radius_mm * MM,
        frequency_hz=own.frequency_mhz * 1e6,
        focus_m=own.focus_mm * MM,
    )
    if own.image_depth_mm is not None:
        array = dataclasses.replace(array, depth_m=own.image_depth_mm * MM)
    return array


def _settings(own: UltrasoundConfig) -> Settings:
    from sim.world.sensing.ultrasound.settings import Settings

    return Settings(
        gain_db=own.gain_db,
        tgc_db_cm_mhz=own.tgc_db_cm_mhz,
        range_db=own.dynamic_range_db,
        n_pixels=own.image_pixels,
    )


RANGES = (
    ("frequency_mhz", 0.5, 20.0),
    ("image_depth_mm", 10.0, 400.0),
    ("array_width_mm", 5.0, 200.0),
    ("gain_db", -100.0, 100.0),
)
"""Options with the ranges beyond which pictures mean nothing."""
FIELD_OF = {
    "face_width_m": "array_width_mm",
    "radius_m": "array_radius_mm",
    "depth_m": "image_depth_mm",
    "frequency_hz": "frequency_mhz",
    "focus_m": "focus_mm",
}
"""The option by the setting of the array that it becomes, for errors."""


def _pair(text: str) -> tuple[str, str]:
    """The name and the tissue of `name=tissue`.

    Raises:
        FieldError: The text has no such form.
    """
    name, equals, tissue = text.rpartition("=")
    if not (equals and name and tissue):
        raise FieldError("structure_tissue", text, "give a structure's name and its tissue as name=tissue.")
    return name, tissue

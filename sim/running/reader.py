"""A sensor whose reader errs, and how far the map trusts it: options, and what they become."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from mapping import ErrorRates, TrustSettings
from planner import Cone
from sim.errors import FieldError, UsageError

from .case import MM

if TYPE_CHECKING:
    from sim.world.sensing.errors.reader_errors import ReaderErrors

ReaderName = Literal["exact", "published", "image"]
IMAGE: ReaderName = "image"
"""The name of the reader that looks at the pictures."""
LabelTrustName = Literal["exact", "told", "learnt"]


@dataclass(frozen=True, kw_only=True)
class ReaderConfig:
    """What the reader of the sensors cone-with-errors and ultrasound gets wrong, and how far labels are trusted.

    A value that is given takes the place of the reader's own.
    """

    reader: ReaderName = "exact"
    """Reader: exact (errs only as the options below say), published (errs as published readers of liver ultrasound do;
    docs/readers.md has the figures), or image (a small network that reads the pictures of the sensor ultrasound, and
    errs as it does)."""
    reader_weights: Path | None = None
    """Weights of the reader image (.safetensors), of a training of your own; by default those that come along."""
    flipped_free: float | None = None
    """Share of free points that the reader calls tumour, each by itself."""
    flipped_tumour: float | None = None
    """Share of tumour points that the reader calls free, each by itself."""
    missed_share: float | None = None
    """Chance that a view misses a lesion of 10 mm at the surface as a whole."""
    missed_size_power: float | None = None
    """That chance falls by this power of the lesion's diameter; 0 for no influence."""
    missed_per_cm: float | None = None
    """That chance grows by exp of this times the lesion's depth [1/cm]."""
    boundary_mm: float | None = None
    """Standard deviation of the outline that is drawn about a lesion's true one [mm]."""
    boundary_share: float | None = None
    """The same as a share of the lesion's radius; both are added in squares."""
    boundary_length_mm: float | None = None
    """How far along the outline it is drawn too tight, or too wide, in one go [mm]."""
    boundary_shared: float | None = None
    """Share of the outline's variance that all views of a lesion have in common, which no further view corrects."""
    false_blobs: float | None = None
    """Mean number of lesions in a view that are none, from 0 to 100."""
    false_blob_mm: float | None = None
    """Median radius of these [mm]."""
    penetration_mm: float | None = None
    """Depth from which nothing comes back any more [mm]."""
    shadowing: tuple[str, ...] = ()
    """Names of structures behind which nothing is seen, as bone and gas hide it."""
    label_trust: LabelTrustName | None = None
    """How far the map and the planner trust labels: exact (they are never wrong), told (they know the rates at which
    the reader errs; the reader image says of each label how sure it is) or learnt (they find the rates as readings
    come); by default told with the reader image, learnt with others that err, and exact where none errs."""


_UNITS = {
    "missed_per_cm": ("missed_per_m", 100.0),
    "boundary_mm": ("boundary_m", MM),
    "boundary_length_mm": ("boundary_length_m", MM),
    "false_blob_mm": ("false_blob_radius_m", MM),
    "penetration_mm": ("penetration_m", MM),
}
"""The errors that fields become which people set in other units, and the factor to them."""
_NOT_ERRORS = ("reader", "reader_weights", "shadowing")
"""Options of a reader that are no size of an error."""


def reader_errors(config: ReaderConfig) -> ReaderErrors:
    """What the reader gets wrong.

    Raises:
        FieldError: A value is out of range; it names the field that people set.
    """
    from sim.world.sensing.errors.published import PUBLISHED
    from sim.world.sensing.errors.reader_errors import ReaderErrors

    errors = PUBLISHED if config.reader == "published" else ReaderErrors()
    for field in _given(config):
        if field in _NOT_ERRORS:
            continue
        name, factor = _UNITS.get(field, (field, 1.0))
        value = getattr(config, field)
        try:
            errors = dataclasses.replace(errors, **{name: value * factor})
        except UsageError as error:
            # The text names errors as `ReaderErrors` does, and ends with their values there.
            text = str(error)
            raise FieldError(field, value, f"{text[text.index('must') :].split(', not ')[0]}.") from error
    return errors


def check_no_reader(config: ReaderConfig, sensor: str) -> None:
    """Refuse options of a reader with a sensor that has none.

    Raises:
        FieldError: An option of the reader is given.
    """
    for name in _given(config):
        raise FieldError(
            name,
            getattr(config, name),
            f"goes only with the sensors cone-with-errors and ultrasound; {sensor} has no such options.",
        )


def check_image_reader(config: ReaderConfig, sensor: str, ultrasound: str) -> None:
    """Refuse what does not go with the reader of images, and what goes with no other.

    Args:
        config: The options.
        sensor: The sensor that is chosen.
        ultrasound: The one that draws pictures.

    Raises:
        FieldError: Options do not go together.
    """
    if config.reader != IMAGE:
        if config.reader_weights is not None:
            raise FieldError("reader_weights", config.reader_weights, f"goes only with the reader {IMAGE}.")
        return
    if sensor != ultrasound:
        problem = f"reads pictures, and the sensor {sensor} draws none. Choose the sensor {ultrasound}."
        raise FieldError("reader", config.reader, problem)
    for name in _given(config):
        if name not in ("reader", "reader_weights"):
            raise FieldError(
                name, getattr(config, name), f"does not go with the reader {IMAGE}, whose errors are its own."
            )


def has_reader(config: ReaderConfig) -> bool:
    """Whether an option of the reader is given."""
    return bool(_given(config))


def _given(config: ReaderConfig) -> list[str]:
    """The options of the reader that are given."""
    return [
        field.name
        for field in dataclasses.fields(config)
        if field.name != "label_trust" and getattr(config, field.name) != field.default
    ]


def label_trust_of(config: ReaderConfig, *, errs: bool) -> LabelTrustName:
    """How far labels are trusted: as the options say, or by default as suits the reader.

    Args:
        config: The options.
        errs: Whether the sensor is one whose reader errs.
    """
    if config.label_trust is not None:
        return config.label_trust
    if not errs:
        return "exact"
    return "told" if config.reader == IMAGE else "learnt"


def trust_settings(config: ReaderConfig, cone: Cone, *, errs: bool) -> TrustSettings | None:
    """How far labels are trusted; None where they are taken as they are.

    Args:
        config: The options.
        cone: What a view holds.
        errs: Whether the sensor is one whose reader errs.

    Raises:
        FieldError: Rates are to be told of a sensor that tells none.
    """
    choice = label_trust_of(config, errs=errs)
    if choice == "exact":
        return None
    if choice == "learnt":
        return TrustSettings()
    if config.reader == IMAGE:
        # Its readings say themselves how far labels can be believed; what is learnt is how often views miss lesions.
        return TrustSettings()
    if not errs:
        raise FieldError(
            "label_trust", choice, "only a reader that errs tells its rates. Choose exact or learnt."
        )
    return TrustSettings(rates=told_rates(reader_errors(config), cone), learns=False)


def told_rates(errors: ReaderErrors, cone: Cone) -> ErrorRates:
    """The rates at which a reader errs in the mean, as a map is told.

    A place is in a false blob with the chance of their mean number times the share of the cone that one fills.

    Args:
        errors: What the reader gets wrong.
        cone: What a view holds.
    """
    cone_m3 = math.pi / 3.0 * cone.depth_m**3 * math.tan(cone.half_angle_rad) ** 2
    return ErrorRates(
        false_positive=errors.flipped_free,
        false_negative=errors.flipped_tumour,
        missed=min(errors.missed_share, 0.45),
        invented=min(errors.false_blobs * errors.false_blob_m3 / cone_m3, 0.45),
    )

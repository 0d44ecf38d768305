"""What a reader of images gets wrong, as plain numbers."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from sim.errors import UsageError

_SHARES = ("missed_share", "boundary_shared")
_FLIPPED = ("flipped_free", "flipped_tumour")
_NOT_NEGATIVE = (
    "missed_size_power",
    "missed_per_m",
    "boundary_m",
    "boundary_share",
    "false_blobs",
)
_POSITIVE = ("boundary_length_m", "false_blob_radius_m", "penetration_m")
BLOB_SPREAD = 0.3
"""Standard deviation of the logarithm of a false blob's radius."""
MOST_FALSE_BLOBS = 100.0
"""Most false lesions in a view: published readers draw less than one, and each takes time with every view."""


@dataclass(frozen=True, kw_only=True)
class ReaderErrors:
    """How often, and how far, a reader of images errs; without values it never does.

    Errors come by lesion and by view: a lesion is missed in a view as a whole, or its outline is drawn too tight here
    and too wide there. Only `flipped_free` and `flipped_tumour` are of single points.
    """

    flipped_free: float = 0.0
    """Share of free points that are called tumour, each by itself."""
    flipped_tumour: float = 0.0
    """Share of tumour points that are called free, each by itself."""
    missed_share: float = 0.0
    """Chance that a view misses a lesion of 10 mm at the surface."""
    missed_size_power: float = 0.0
    """That chance falls by this power of the lesion's diameter; 0 for no influence."""
    missed_per_m: float = 0.0
    """That chance grows by exp of this times the depth of the lesion's nearest point below the tip [1/m]."""
    missed_by_echogenicity: bool = False
    """Whether lesions that look like liver are missed more often, see `echogenicity`."""
    boundary_m: float = 0.0
    """Standard deviation of the outline that is drawn about the lesion's true one [m]."""
    boundary_share: float = 0.0
    """The same as a share of the lesion's radius, which is added in squares."""
    boundary_by_echogenicity: bool = False
    """Whether the outline of lesions that look like liver is drawn worse, see `echogenicity`."""
    boundary_length_m: float = 0.010
    """How far along the outline it is drawn too tight, or too wide, in one go: the length of a smooth field [m]."""
    boundary_shared: float = 0.0
    """Share of the outline's variance that all views of a lesion have in common; what they share no view corrects."""
    false_blobs: float = 0.0
    """Mean number of lesions in a view that are none, at most 100."""
    false_blob_radius_m: float = 0.006
    """Their median radius [m]; its logarithm has the standard deviation `BLOB_SPREAD`."""
    penetration_m: float = np.inf
    """Depth along the beam from which nothing comes back any more [m]."""

    @property
    def false_blob_m3(self) -> float:
        """Mean volume of a false blob [m^3]: the mean cube of a lognormal radius is exp(9 s^2 / 2) its median's."""
        return float(4.0 / 3.0 * np.pi * self.false_blob_radius_m**3 * np.exp(4.5 * BLOB_SPREAD**2))

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            UsageError: A value is out of its range; the text names it.
        """
        for each in fields(self):
            name, value = each.name, getattr(self, each.name)
            if name in _SHARES and not 0.0 <= value <= 1.0:
                raise UsageError(f"`{name}` must be from 0 to 1, not {value:g}.")
            if name in _FLIPPED and not 0.0 <= value < 1.0:
                raise UsageError(
                    f"`{name}` must be 0 or more and below 1, since at 1 every such label is wrong, not {value:g}."
                )
            if name in _NOT_NEGATIVE and not 0.0 <= value < np.inf:
                raise UsageError(f"`{name}` must be 0 or more and finite, not {value:g}.")
            if name in _POSITIVE and not value > 0.0:
                raise UsageError(f"`{name}` must be above 0, not {value:g}.")
        if self.false_blobs > MOST_FALSE_BLOBS:
            raise UsageError(
                f"`false_blobs` must be at most {MOST_FALSE_BLOBS:g}, more than which hide the view, not "
                f"{self.false_blobs:g}."
            )
        if self.flipped_free + self.flipped_tumour >= 1.0:
            raise UsageError(
                f"`flipped_tumour` must add up to less than 1 with `flipped_free` of {self.flipped_free:g}, since at 1 "
                f"a label says nothing, not {self.flipped_tumour:g}."
            )

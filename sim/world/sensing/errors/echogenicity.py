"""How a lesion looks beside liver: darker, brighter, of both kinds, or alike.

Readers do worse where a lesion looks like the tissue about it. Natali et al. (2024, intraoperative ultrasound of the
liver) give a Dice of 0.89 for hypoechoic, 0.88 for mixed, 0.70 for hyperechoic and 0.60 for isoechoic lesions, and 0.84
over all. Their mixture is not at hand; the shares here give the same mean.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sim.world.solids.solid import Solid


@dataclass(frozen=True, kw_only=True)
class Echogenicity:
    """A look of lesions, and how readers do with it."""

    name: str
    share: float
    """Share of all lesions that look so."""
    published_dice: float
    """Dice of readers, by Natali et al. (2024)."""
    outline_factor: float
    """By how much more, or less, than the mean the outline strays: fitted to that Dice."""
    missed_factor: float
    """By how much more, or less, than the mean such a lesion is missed: assumed, since no figures were found."""


HYPOECHOIC = Echogenicity(
    name="hypoechoic", share=0.62, published_dice=0.89, outline_factor=0.64, missed_factor=0.6
)
MIXED = Echogenicity(name="mixed", share=0.15, published_dice=0.88, outline_factor=0.72, missed_factor=1.0)
HYPERECHOIC = Echogenicity(
    name="hyperechoic", share=0.17, published_dice=0.70, outline_factor=1.9, missed_factor=1.6
)
ISOECHOIC = Echogenicity(
    name="isoechoic", share=0.06, published_dice=0.60, outline_factor=2.9, missed_factor=3.4
)
ECHOGENICITIES = (HYPOECHOIC, MIXED, HYPERECHOIC, ISOECHOIC)


@lru_cache(maxsize=256)
def lesion_rng_seed(lesion: Solid) -> int:
    """A number that belongs to a lesion: whatever is drawn by it, every view and every planner finds the same."""
    return zlib.crc32(lesion.vertices_m.tobytes())


def echogenicity_of(lesion: Solid) -> Echogenicity:
    """How a lesion looks; drawn once by the shares, from a number that belongs to the lesion."""
    draw = np.random.default_rng((lesion_rng_seed(lesion), 0)).random()
    ends = np.cumsum([each.share for each in ECHOGENICITIES])
    return ECHOGENICITIES[min(int(np.searchsorted(ends, draw, side="right")), len(ECHOGENICITIES) - 1)]

"""What the labels of a volume mean: published codings by name, or numbers that the user gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    # A scenario needs only the names of the codings, and then loads no arrays.
    from .volume import Volume

CodingName = Literal["auto", "lits", "msd-liver", "3d-ircadb", "totalsegmentator", "totalsegmentator-v1"]
"""What the numbers of a label volume mean: `auto` for what the labels tell, or one of `CODINGS`."""


@dataclass(frozen=True, kw_only=True)
class Coding:
    """Which labels are what.

    Attributes:
        organ: Labels of the organ; tumours are added to it. Empty means every label.
        tumours: Labels of tumours; each connected piece of one is a tumour of its own.
        targets: Labels of a second class to be mapped, piece by piece as tumours are.
        structures: Labels of vessels and other structures, by name.
        keepouts: Those of them that must not be pressed.
    """

    organ: tuple[int, ...]
    tumours: tuple[int, ...] = ()
    targets: tuple[int, ...] = ()
    structures: Mapping[str, int] = field(default_factory=dict)
    keepouts: Mapping[str, int] = field(default_factory=dict)


CODINGS: dict[str, Coding] = {
    "lits": Coding(organ=(1,), tumours=(2,)),
    "msd-liver": Coding(organ=(1,), tumours=(2,)),
    "3d-ircadb": Coding(organ=()),
    "totalsegmentator": Coding(
        organ=(5,),
        structures={"gallbladder": 4, "inferior vena cava": 63, "portal and splenic vein": 64},
    ),
    "totalsegmentator-v1": Coding(
        organ=(5,),
        structures={"gallbladder": 4, "inferior vena cava": 8, "portal and splenic vein": 9},
    ),
}
"""LiTS (Bilic et al. 2023) and the Medical Segmentation Decathlon's Task03 (Antonelli et al. 2022) mark liver and
tumour as 1 and 2; 3D-IRCADb-01 has a mask per structure, 255 inside; TotalSegmentator's task `total`, version 2
(Wasserthal et al. 2023), numbers 117 structures and has no tumours; version 1 numbered 104 in another order."""


@dataclass(frozen=True, kw_only=True)
class LabelChoice:
    """What a user says of the labels: the name of a coding, and numbers that take precedence over it.

    Attributes:
        coding: One of `CODINGS`, or auto for what the labels tell.
        organ: Labels of the organ.
        tumours: Labels of tumours.
        targets: Labels of the second class.
        structures: Labels of structures to show.
        keepouts: Labels of structures that must not be pressed.
    """

    coding: str = "auto"
    organ: tuple[int, ...] = ()
    tumours: tuple[int, ...] = ()
    targets: tuple[int, ...] = ()
    structures: tuple[int, ...] = ()
    keepouts: tuple[int, ...] = ()


def describe_labels(volume: Volume, most: int = 12) -> str:
    """The labels of a volume with their volumes in ml, the largest first."""
    by_size = sorted(volume.counts, key=lambda label: -volume.counts[label])
    texts = [
        f"{volume.label_text(label)} ({volume.counts[label] * volume.voxel_volume_m3 * 1e6:.3g} ml)"
        for label in by_size[:most]
    ]
    return ", ".join(texts) + (f" and {len(by_size) - most} more" if len(by_size) > most else "")

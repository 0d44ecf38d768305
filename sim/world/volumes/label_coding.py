"""What the labels of a volume mean: published codings by name, or numbers that the user gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from sim.world.errors import VolumeError

if TYPE_CHECKING:
    # A scenario needs only the names of the codings, and then loads no arrays.
    from .volume import Volume

CodingName = Literal["auto", "lits", "msd-liver", "3d-ircadb", "totalsegmentator"]
"""What the numbers of a label volume mean: `auto` for what the labels tell, or one of `CODINGS`."""

WORDS = {
    "organ": ("liver", "leber", "foie"),
    "tumour": ("tumor", "tumour", "lesion", "cancer", "metasta", "hcc"),
}
"""Parts of the names that 3D Slicer's users give their segments."""


MOST_TOTAL_LABEL = 117
"""TotalSegmentator's highest label."""

LIVER_RANGE_M3 = (0.2e-3, 6e-3)
"""Label 5 is taken for TotalSegmentator's liver if it has such a volume [m^3]."""


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
}
"""LiTS (Bilic et al. 2023) and the Medical Segmentation Decathlon's Task03 (Antonelli et al. 2022) mark liver and
tumour as 1 and 2; 3D-IRCADb-01 has a mask per structure, 255 inside; TotalSegmentator's task `total`, version 2
(Wasserthal et al. 2023), numbers 117 structures and has no tumours."""


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


def coding_of(volume: Volume, choice: LabelChoice, path: object) -> tuple[Coding, list[str]]:
    """The coding of a volume, and what was assumed.

    Args:
        volume: The labels.
        choice: What the user says.
        path: The file, for messages.

    Raises:
        VolumeError: The coding is not known, the labels are ambiguous, or the organ is not there.
    """
    if choice.coding != "auto" and choice.coding not in CODINGS:
        raise VolumeError(f"coding {choice.coding!r} is not known; use one of auto, {', '.join(CODINGS)}")
    remarks: list[str] = []
    if choice.coding != "auto":
        base = CODINGS[choice.coding]
    elif choice.organ:
        base = Coding(organ=choice.organ)
    else:
        base, remarks = _guess(volume, path)
    coding = Coding(
        organ=choice.organ or base.organ or tuple(volume.counts),
        tumours=choice.tumours or base.tumours,
        targets=choice.targets,
        structures={
            **{name: label for name, label in base.structures.items() if label not in choice.targets},
            **_named(volume, choice.structures),
        },
        keepouts=_named(volume, choice.keepouts),
    )
    _check_present(volume, coding, choice, path)
    _check_targets(coding, path)
    return coding, remarks


def _guess(volume: Volume, path: object) -> tuple[Coding, list[str]]:
    """The coding that a volume's names or labels tell, and what was assumed.

    Raises:
        VolumeError: They tell none.
    """
    labels, names = set(volume.counts), volume.label_names
    if names:
        organ = _like(names, WORDS["organ"], without=WORDS["tumour"])
        tumours = tuple(label for label in _like(names, WORDS["tumour"]) if label in labels)
        if organ:
            others = {name: label for label, name in names.items() if label not in (*organ, *tumours)}
            return Coding(organ=organ, tumours=tumours, structures=others), []
    if len(labels) == 1:
        return Coding(organ=tuple(labels)), []
    if labels == {1, 2}:
        return CODINGS["lits"], []
    liver_m3 = volume.counts.get(5, 0) * volume.voxel_volume_m3
    if 10 < max(labels) <= MOST_TOTAL_LABEL and LIVER_RANGE_M3[0] <= liver_m3 <= LIVER_RANGE_M3[1]:
        return CODINGS["totalsegmentator"], ["the labels are taken for TotalSegmentator's: 5 is the liver"]
    *others, last = CODINGS
    raise VolumeError(
        f"{path}: which of its labels is the organ? It holds {describe_labels(volume)}. Pass `organ_label` N, "
        f"and `tumour_label` M if there are tumours, or `coding` {', '.join(others)} or {last}"
    )


def _like(
    names: Mapping[int, str], words: tuple[str, ...], *, without: tuple[str, ...] = ()
) -> tuple[int, ...]:
    return tuple(
        label
        for label, name in names.items()
        if any(word in name.lower() for word in words) and not any(word in name.lower() for word in without)
    )


def _named(volume: Volume, labels: tuple[int, ...]) -> dict[str, int]:
    return {volume.label_names.get(label, f"label {label}"): label for label in labels}


def _check_present(volume: Volume, coding: Coding, choice: LabelChoice, path: object) -> None:
    """Nothing, if the organ's labels and all those that the user names are in the file.

    Raises:
        VolumeError: One is not.
    """
    wanted = {
        "organ_label": coding.organ,
        "tumour_label": choice.tumours,
        "target_label": choice.targets,
        "structure_label": choice.structures,
        "keepout_label": choice.keepouts,
    }
    for option, labels in wanted.items():
        if absent := [label for label in labels if label not in volume.counts]:
            raise VolumeError(
                f"{path}: `{option}` {' '.join(map(str, absent))} is not in the file, which holds "
                f"{describe_labels(volume)}; pass the right label"
            )


def _check_targets(coding: Coding, path: object) -> None:
    """Nothing, if the labels of the second class are not those of the tumours or of the whole organ.

    Raises:
        VolumeError: They are.
    """
    taken = {"tumours": coding.tumours}
    if set(coding.organ) <= set(coding.targets):
        taken["the whole organ"] = coding.organ
    for what, labels in taken.items():
        if shared := sorted(set(labels) & set(coding.targets)):
            raise VolumeError(
                f"{path}: `target_label` {' '.join(map(str, shared))} means {what} already; pass the label of another "
                "class"
            )


def describe_labels(volume: Volume, most: int = 12) -> str:
    """The labels of a volume with their volumes in ml, the largest first."""
    by_size = sorted(volume.counts, key=lambda label: -volume.counts[label])
    texts = []
    for label in by_size[:most]:
        name = f" {volume.label_names[label]!r}" if label in volume.label_names else ""
        texts.append(f"{label}{name} ({volume.counts[label] * volume.voxel_volume_m3 * 1e6:.3g} ml)")
    return ", ".join(texts) + (f" and {len(by_size) - most} more" if len(by_size) > most else "")

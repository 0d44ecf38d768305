"""What label numbers mean that have no names: the codings that are in wide use, told by which numbers there are.

A guess is checked against what the labels look like, and always said.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .label_coding import CODINGS, Coding
from .masks import box_of, count_pieces
from .volume import Volume

MOST_TOTAL_LABEL = 117
"""TotalSegmentator's highest label, in version 2."""

MOST_TOTAL_V1_LABEL = 104
"""And in version 1."""

LIVER_RANGE_M3 = (0.2e-3, 6e-3)
"""Label 5 is taken for TotalSegmentator's liver if it has such a volume [m^3]."""

SMALLER_ORGANS = (1, 2, 3, 4)
"""TotalSegmentator's spleen, kidneys and gallbladder, none of which is larger than a liver."""

LEAST_FILL = 0.12
"""Least share of its bounding box that an organ fills: livers fill 0.2 and more, trees of vessels 0.06 and less."""

CAVA_RANGE_M3 = (8e-6, 300e-6)
"""Volumes of a vena cava [m^3]; an adrenal gland has 5 ml."""

CAVA_STRETCH = 1.3
"""A vena cava is at least this many times as long from foot to head as it is wide; a rib runs across."""

CAVA = "inferior vena cava"


@dataclass(frozen=True, kw_only=True)
class Guess:
    """What the numbers of labels tell.

    Attributes:
        coding: The coding; None if they tell none.
        remarks: What was assumed, or why nothing was.
    """

    coding: Coding | None = None
    remarks: tuple[str, ...] = ()


def guess_by_numbers(volume: Volume) -> Guess:
    """The coding that the numbers of a volume's labels tell."""
    labels = sorted(volume.counts)
    if len(labels) == 1:
        return _one_label(volume, labels[0])
    if labels == [1, 2]:
        return _liver_and_tumour(volume)
    liver_m3 = volume.counts.get(5, 0) * volume.voxel_volume_m3
    if 10 < labels[-1] <= MOST_TOTAL_LABEL and LIVER_RANGE_M3[0] <= liver_m3 <= LIVER_RANGE_M3[1]:
        return _whole_body(volume)
    return Guess()


def _one_label(volume: Volume, label: int) -> Guess:
    remarks = [f"its one label, {volume.label_text(label)}, is taken for the organ"]
    fill = fill_of(volume, (label,))
    if fill < LEAST_FILL:
        remarks.append(
            f"that label fills {fill:.0%} of its bounding box, as a tree of vessels does, and an organ fills more: "
            "check that it is the organ"
        )
    return Guess(coding=Coding(organ=(label,)), remarks=tuple(remarks))


def _liver_and_tumour(volume: Volume) -> Guess:
    """LiTS's coding, if label 1 looks like an organ and label 2 like a part of it."""
    fill, reasons = fill_of(volume, (1, 2)), []
    if fill < LEAST_FILL:
        reasons.append(
            f"they fill {fill:.0%} of their bounding box, as a tree of vessels does, and an organ more"
        )
    if volume.counts[2] > volume.counts[1]:
        reasons.append("label 2 is larger than label 1, as tumours seldom are than the rest of their organ")
    if reasons:
        said = f"labels 1 and 2 are LiTS's liver and tumour, but {' and '.join(reasons)}"
        return Guess(remarks=(f"{said}: `coding` lits takes them all the same",))
    assumed = "its labels are taken for LiTS's: 1 is the organ, 2 its tumours"
    return Guess(coding=CODINGS["lits"], remarks=(assumed,))


def _whole_body(volume: Volume) -> Guess:
    """TotalSegmentator's coding, with those structures that look like what they should be."""
    larger = [label for label in SMALLER_ORGANS if volume.counts.get(label, 0) > volume.counts[5]]
    fill = fill_of(volume, (5,))
    if larger or fill < LEAST_FILL:
        reason = f"label {larger[0]} is larger" if larger else f"it fills {fill:.0%} of its bounding box"
        return Guess(remarks=(f"label 5 would be TotalSegmentator's liver, but {reason}",))
    version = _version(volume)
    name = "totalsegmentator" if version == 2 else "totalsegmentator-v1"
    structures = {
        each: label
        for each, label in CODINGS[name].structures.items()
        if label in volume.counts and (version is not None or each == "gallbladder")
    }
    texts = ["5 is the liver", *(f"{label} the {each}" for each, label in structures.items())]
    which = f"of version {version}" if version is not None else "of which version cannot be told"
    said = f"its labels are taken for TotalSegmentator's, {which}: {', '.join(texts)}"
    return Guess(coding=Coding(organ=(5,), structures=structures), remarks=(said,))


def _version(volume: Volume) -> int | None:
    """TotalSegmentator's version, by which label looks like a vena cava; None where none does, or both do."""
    if max(volume.counts) > MOST_TOTAL_V1_LABEL:
        return 2
    labels = {
        1: CODINGS["totalsegmentator-v1"].structures[CAVA],
        2: CODINGS["totalsegmentator"].structures[CAVA],
    }
    able = [version for version, label in labels.items() if is_like_cava(volume, label)]
    return able[0] if len(able) == 1 else None


def remarks_on_shapes(volume: Volume, structures: Mapping[str, int]) -> list[str]:
    """A sentence, where a coding that the user names has a vena cava that does not look like one."""
    label = structures.get(CAVA)
    if label is None or label not in volume.counts or is_like_cava(volume, label):
        return []
    return [
        f"label {label} is the {CAVA} in this coding and does not look like one: TotalSegmentator's versions number "
        "differently, check `coding`"
    ]


def is_like_cava(volume: Volume, label: int) -> bool:
    """Whether a label is there and has the size and the direction of a vena cava."""
    if not CAVA_RANGE_M3[0] <= volume.counts.get(label, 0) * volume.voxel_volume_m3 <= CAVA_RANGE_M3[1]:
        return False
    across_x, across_y, along = _extents_m(volume, (label,))
    return bool(along >= CAVA_STRETCH * max(across_x, across_y))


def fill_of(volume: Volume, labels: Iterable[int]) -> float:
    """The share of its bounding box that the largest piece of some labels fills."""
    piece = _largest_piece(volume, labels)
    return float(piece.mean())


def _extents_m(volume: Volume, labels: Iterable[int]) -> NDArray[np.float64]:
    """The extents of the largest piece along the patient's axes, roughly where the scan is oblique [m]."""
    piece = _largest_piece(volume, labels)
    return np.abs(volume.T_lps_voxel[:3, :3]) @ np.array(piece.shape)


def _largest_piece(volume: Volume, labels: Iterable[int]) -> NDArray[np.bool_]:
    """The largest connected piece of some labels, in its bounding box."""
    mask = np.isin(volume.labels, volume.numbers_of(labels))
    mask = mask[box_of(mask)]
    numbers = np.empty(mask.shape, dtype=np.int32)
    if count_pieces(mask, numbers, is_by_corner=True) > 1:
        mask = numbers == np.bincount(numbers[mask]).argmax()
    return mask[box_of(mask)]

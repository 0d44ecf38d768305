"""What label numbers mean that have no names: the codings that are in wide use, told by which numbers there are."""

from __future__ import annotations

from .label_coding import CODINGS, Coding
from .volume import Volume

MOST_TOTAL_LABEL = 117
"""TotalSegmentator's highest label."""

LIVER_RANGE_M3 = (0.2e-3, 6e-3)
"""Label 5 is taken for TotalSegmentator's liver if it has such a volume [m^3]."""


def guess_by_numbers(volume: Volume, path: object) -> tuple[Coding, list[str]] | None:
    """The coding that the numbers of a volume's labels tell, and what was assumed; None if they tell none.

    Args:
        volume: The labels.
        path: The file, for messages.
    """
    labels = set(volume.counts)
    if len(labels) == 1:
        return Coding(organ=tuple(labels)), []
    if labels == {1, 2}:
        return CODINGS["lits"], []
    liver_m3 = volume.counts.get(5, 0) * volume.voxel_volume_m3
    if 10 < max(labels) <= MOST_TOTAL_LABEL and LIVER_RANGE_M3[0] <= liver_m3 <= LIVER_RANGE_M3[1]:
        return CODINGS["totalsegmentator"], ["the labels are taken for TotalSegmentator's: 5 is the liver"]
    return None

"""What a planner expects to be left: how many lesions it has not found, and how many of these nobody could."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class WhatIsLeft:
    """Expectations about the lesions that no reading has met."""

    n_found: int
    """Number of lesions found."""
    expected_left: float
    """Expected number of lesions that are left and that some pose could find."""
    chance_of_none: float
    """Probability that there are none of these."""
    unseeable_share: float
    """Share of all places and sizes that a lesion could have at which no pose could find it."""
    expected_unseeable: float
    """Expected number of lesions there; nothing that was sensed tells of them but how many there are elsewhere."""

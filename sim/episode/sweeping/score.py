"""What a sweep did in one action: its readings as one, and the figures that are told of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping import LabelledPoints, MapSettings, merged
from planner import Cone
from planner.stopping.lesion_count import label_spacing_m
from sim.world.sensing.reading import Reading

from ..moving.motion import Motion

SWEEP_CELLS = ("n_readings", "n_lift_offs", "contact_path_m")
"""Figures of an action that tables have, and whose sums a summary has."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SweepScore:
    """What was read on the way of one action."""

    n_readings: int
    n_lift_offs: int
    """How often the probe was taken off the organ."""
    contact_path_m: float
    """Length of the tip's way over the organ [m]."""
    read_s: tuple[float, ...]
    """When each reading was taken since the action began [s]."""
    T_world_readings: NDArray[np.float64]
    """Where the probe was believed to be at each, shape (n_readings, 4, 4)."""

    @classmethod
    def of(cls, motion: Motion, readings: Sequence[Reading]) -> SweepScore:
        """The figures of a motion and its readings."""
        return cls(
            n_readings=len(readings),
            n_lift_offs=motion.n_lift_offs,
            contact_path_m=motion.contact_path_m,
            read_s=tuple(float(motion.time_s[row]) for row in motion.passed_rows),
            T_world_readings=np.array([reading.T_world_probe for reading in readings]),
        )


def joined_reading(readings: Sequence[Reading]) -> Reading:
    """The points of several readings as one, taken where the last one was.

    Args:
        readings: At least one, all of one sensor; pictures are those of the last.
    """
    if len(readings) == 1:
        return readings[0]
    parts = {
        name: np.concatenate([getattr(reading, name) for reading in readings])
        for name in ("points_m", "is_occupied", "is_target", "log_odds", "weight")
        if getattr(readings[-1], name) is not None
    }
    return replace(readings[-1], **parts)


def taught_together(
    labels: Sequence[LabelledPoints], cone: Cone, settings: MapSettings
) -> list[LabelledPoints]:
    """The readings of an action as the map takes them in: as one, without what an exact sensor says twice.

    Args:
        labels: What was read.
        cone: What a reading sees.
        settings: What the map believes of the sensor.
    """
    is_exact = settings.false_positive_rate + settings.false_negative_rate == 0.0
    return merged(labels, label_spacing_m(cone, labels) if is_exact else 0.0)

"""Where the readings of an episode were laid, and when they are laid anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..labelled_points import LabelledPoints
from .moves import most_moved_m

Array = NDArray[np.float64]

MOVED_M, MOVED_SHARE = 0.0005, 0.5
"""Readings are laid anew when what is believed has moved the points of one by more than this since, a root mean square
[m], and by more than this share of how far readings are believed to be off."""
FAR_M = 0.002
"""Only when they have moved by more than this [m] since all of the map was last laid, all of it is again: up to there a
map in detail moves nothing but its answers near tumour. Its other answers are as smooth as its hinges are wide apart,
11 mm."""


class Laid(NamedTuple):
    """All readings, at where they are now believed to lie."""

    readings: list[LabelledPoints]
    is_moved: bool
    """Whether others than the new one have moved by enough for all to be laid anew."""
    is_far: bool
    """Whether some have moved by much since readings were last laid into a new map."""


class LaidReadings:
    """What took each reading back to rest when it was last laid, and when it was laid into a new map."""

    def __init__(self) -> None:
        """Begin without a reading."""
        self._by: list[Array] = []
        self._new_by: list[Array] = []

    def add(self, T_rest_world: Array) -> None:
        """Note what took a new reading back to rest, shape (4, 4)."""
        self._by.append(T_rest_world)
        self._new_by.append(T_rest_world)

    def anew(
        self,
        readings: Sequence[LabelledPoints],
        now: Sequence[Array],
        deviation_m: float,
        points_of: Callable[[int], Array],
    ) -> Laid | None:
        """The readings at where they are now believed to lie; None where that is near where they lie already.

        Args:
            readings: The readings so far, in their order, at rest; the new one is the last.
            now: What takes each to rest now, shapes (4, 4).
            deviation_m: How far readings are believed to be off [m].
            points_of: The points of a reading before the probe pressed, world frame [m], shape (K, 3).
        """
        least_m = MOVED_SHARE * deviation_m
        if most_moved_m(readings[:-1], now[:-1], self._by[:-1]) <= max(MOVED_M, least_m):
            if np.array_equal(now[-1], self._by[-1]):
                return None
            self._by[-1] = self._new_by[-1] = now[-1]
            laid = [*readings[:-1], _laid(readings[-1], now[-1], points_of(len(now) - 1))]
            return Laid(laid, is_moved=False, is_far=False)
        is_far = most_moved_m(readings, now, self._new_by) > max(FAR_M, least_m)
        self._by = list(now)
        self._new_by = list(now) if is_far else [*self._new_by[:-1], now[-1]]
        laid = [_laid(each, T, points_of(i)) for i, (each, T) in enumerate(zip(readings, now, strict=True))]
        return Laid(laid, is_moved=True, is_far=is_far)


def _laid(reading: LabelledPoints, T_rest_world: Array, points_m: Array) -> LabelledPoints:
    return reading.at(points_m @ T_rest_world[:3, :3].T + T_rest_world[:3, 3])

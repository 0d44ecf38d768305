"""The labels that a map has been told, thinned out, and which of them count near tumour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..labelled_points import LabelledPoints
from .local_classifier import Neighbours
from .outline import heeding_outline

_MOST_CHANCE = 0.99
"""Largest chance of a false label; at 1 a label would say nothing, and its spread would be infinite."""


class LabelMemory:
    """The labels of all readings, one of each kind in each small cube; `add` changes it.

    Where readings overlap, their points lie ever closer together, and the nearest ones to a place would say little of
    what lies around it. So only the first of each kind in a cube is kept. Of those that are kept, the ones within
    `range_m` of a label of tumour that can be believed are in play: among them a classifier looks for neighbours.
    """

    def __init__(
        self, *, cube_m: float, range_m: float, false_positive_rate: float, stray_m: float = 0.0
    ) -> None:
        """Makes it empty.

        Args:
            cube_m: Side of the cubes [m].
            range_m: How near to tumour a label is in play [m].
            false_positive_rate: Share of free points that the sensor is believed to call tumour.
            stray_m: How far outlines stray that a view draws [m], where labels err together.
        """
        self._stray_m = stray_m
        self._cube_m, self._range_m, self._rate = cube_m, range_m, false_positive_rate
        self._cubes: set[tuple[int, int, int, int]] = set()
        self.points_m = np.empty((0, 3))
        self.is_tumour = np.empty(0, dtype=bool)
        self.log_odds = np.empty(0)
        """How far each label can be believed, shape (L,); NaN where nobody says."""
        self.weight = np.empty(0)
        """How many labels each counts for within its reading, shape (L,)."""
        self.reading = np.empty(0, dtype=np.int64)
        """The number of the reading that each label is of, shape (L,)."""
        self._n_readings = 0
        self.tumour_m = np.empty((0, 3))
        """The labels of tumour that can be believed [m], shape (T, 3)."""
        self.is_in_play = np.empty(0, dtype=bool)
        self._tree: KDTree | None = None

    def add(self, reading: LabelledPoints) -> tuple[LabelledPoints, NDArray[np.float64], NDArray[np.float64]]:
        """Takes in a reading.

        Returns:
            What was kept of it, its labels of tumour that can be believed [m], shape (T, 3), and the points [m] that
            have come into play, of this reading or of an earlier one, shape (P, 3).
        """
        before = self.is_in_play
        new, tumour_m = self._kept([reading])
        before = np.concatenate([before, np.zeros(len(new.points_m), dtype=bool)])
        if len(self.tumour_m):
            is_new = np.arange(len(self.points_m)) >= len(self.points_m) - len(new.points_m)
            self._bring_in(np.flatnonzero(is_new), self.tumour_m)
            self._bring_in(np.flatnonzero(~is_new & ~before), tumour_m)
        entered = self.is_in_play & ~before
        if entered.any():
            self._tree = None
        return new, tumour_m, self.points_m[entered]

    def add_all(self, readings: Sequence[LabelledPoints]) -> None:
        """Takes in readings at once, before any other: what is kept is what `add` keeps of one after the other."""
        self._kept(readings)
        self._bring_in(np.arange(len(self.points_m)), self.tumour_m)
        self._tree = None

    def _kept(self, readings: Sequence[LabelledPoints]) -> tuple[LabelledPoints, NDArray[np.float64]]:
        """Keeps what is to be kept of readings, none of it in play yet.

        Returns:
            What was kept of the last one, and its labels of tumour that can be believed [m], shape (T, 3).
        """
        columns: list[tuple[NDArray, ...]] = [
            (self.points_m, self.is_tumour, self.log_odds, self.weight, self.reading, self.tumour_m)
        ]
        new, tumour_m = LabelledPoints(np.empty((0, 3)), np.empty(0, dtype=bool)), np.empty((0, 3))
        for reading in readings:
            new = self._thinned(heeding_outline(reading, self._stray_m) if self._stray_m > 0.0 else reading)
            tumour_m = reading.believed_tumour_m(self._rate)
            said = np.full(len(new.points_m), np.nan) if new.log_odds is None else new.log_odds
            counted = np.ones(len(said)) if new.weight is None else new.weight
            of_reading = np.full(len(said), self._n_readings)
            columns.append((new.points_m, new.is_occupied, said, counted, of_reading, tumour_m))
            self._n_readings += 1
        n_before = len(self.points_m)
        self.points_m, self.is_tumour, self.log_odds, self.weight, self.reading, self.tumour_m = (
            np.concatenate(each) for each in zip(*columns, strict=True)
        )
        is_later = np.zeros(len(self.points_m) - n_before, dtype=bool)
        self.is_in_play = np.concatenate([self.is_in_play, is_later])
        return new, tumour_m

    def neighbours(
        self, points_m: NDArray[np.float64], n: int
    ) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """The nearest labels in play of each point, nearest first.

        Args:
            points_m: Points [m], shape (N, 3).
            n: Number of neighbours; fewer where fewer are in play.

        Returns:
            Their distances [m] and their indices among all labels, both of shape (N, n).
        """
        in_play = np.flatnonzero(self.is_in_play)
        if self._tree is None:
            self._tree = KDTree(self.points_m[in_play])
        # A list of neighbours keeps the shape (N, n) where n is 1; the stubs know only a number.
        ranks: list[int] = [*range(1, min(n, len(in_play)) + 1)]
        distance_m, nearest = self._tree.query(points_m, k=ranks)  # pyright: ignore[reportArgumentType]
        return distance_m, in_play[nearest]

    def neighbours_of(self, nearest: NDArray[np.intp], rates: tuple[float, float]) -> Neighbours:
        """What the classifier needs of some labels.

        A label whose own say is known, L = log P(label | tumour) / P(label | free), is one of a sensor that never errs
        the other way: it calls a share exp(-L) of free points tumour, or a share exp(L) of tumour points free. Labels
        of one reading that err together count for one among the neighbours of a place.

        Args:
            nearest: Indices of the neighbours of N places, shape (N, k).
            rates: The sensor's rates of false positives and of false negatives, for labels of which nobody says more.
        """
        points_m, is_tumour = self.points_m[nearest], self.is_tumour[nearest]
        log_odds = self.log_odds[nearest]
        is_known = ~np.isnan(log_odds)
        if not is_known.any():
            return Neighbours(points_m, is_tumour, *rates, 1.0)
        chance = np.minimum(np.exp(-np.abs(log_odds)), _MOST_CHANCE)
        false_positive = np.where(is_known, np.where(is_tumour, chance, 0.0), rates[0])
        false_negative = np.where(is_known, np.where(is_tumour, 0.0, chance), rates[1])
        reading = self.reading[nearest]
        n_together = (reading[:, :, None] == reading[:, None]).sum(axis=2)
        weight = np.maximum(self.weight[nearest], 1.0 / n_together)
        return Neighbours(points_m, is_tumour, false_positive, false_negative, weight)

    def _bring_in(self, candidates: NDArray[np.intp], tumour_m: NDArray[np.float64]) -> None:
        """Brings into play those candidates that lie in range of some labels of tumour."""
        if candidates.size and len(tumour_m):
            gap_m, _ = KDTree(tumour_m).query(
                self.points_m[candidates], distance_upper_bound=self._range_m, workers=1
            )
            self.is_in_play[candidates[np.isfinite(gap_m)]] = True

    def _thinned(self, reading: LabelledPoints) -> LabelledPoints:
        """The first point of each kind in each cube that held none of that kind yet."""
        cubes = np.floor(reading.points_m / self._cube_m).astype(np.int64)
        keys = map(tuple, np.column_stack([cubes, reading.is_occupied]).tolist())
        is_kept = np.zeros(len(cubes), dtype=bool)
        for i, key in enumerate(keys):
            if key not in self._cubes:
                self._cubes.add(key)
                is_kept[i] = True
        log_odds = None if reading.log_odds is None else reading.log_odds[is_kept]
        weight = None if reading.weight is None else reading.weight[is_kept]
        return LabelledPoints(reading.points_m[is_kept], reading.is_occupied[is_kept], log_odds, weight)

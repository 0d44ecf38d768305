"""The labels that a map has been told, thinned out, and which of them count near tumour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..labelled_points import LabelledPoints


class LabelMemory:
    """The labels of all readings, one of each kind in each small cube; `add` changes it.

    Where readings overlap, their points lie ever closer together, and the nearest ones to a place would say little of
    what lies around it. So only the first of each kind in a cube is kept. Of those that are kept, the ones within
    `range_m` of a label of tumour that can be believed are in play: among them a classifier looks for neighbours.
    """

    def __init__(self, *, cube_m: float, range_m: float, false_positive_rate: float) -> None:
        """Makes it empty.

        Args:
            cube_m: Side of the cubes [m].
            range_m: How near to tumour a label is in play [m].
            false_positive_rate: Share of free points that the sensor is believed to call tumour.
        """
        self._cube_m, self._range_m, self._rate = cube_m, range_m, false_positive_rate
        self._cubes: set[tuple[int, int, int, int]] = set()
        self.points_m = np.empty((0, 3))
        self.is_tumour = np.empty(0, dtype=bool)
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
        new = self._thinned(reading)
        tumour_m = reading.believed_tumour_m(self._rate)
        self.points_m = np.concatenate([self.points_m, new.points_m])
        self.is_tumour = np.concatenate([self.is_tumour, new.is_occupied])
        self.tumour_m = np.concatenate([self.tumour_m, tumour_m])
        before = np.concatenate([self.is_in_play, np.zeros(len(new.points_m), dtype=bool)])
        self.is_in_play = before.copy()
        if len(self.tumour_m):
            is_new = np.arange(len(self.points_m)) >= len(self.points_m) - len(new.points_m)
            self._bring_in(np.flatnonzero(is_new), self.tumour_m)
            self._bring_in(np.flatnonzero(~is_new & ~before), tumour_m)
        entered = self.is_in_play & ~before
        if entered.any():
            self._tree = None
        return new, tumour_m, self.points_m[entered]

    def neighbours(
        self, points_m: NDArray[np.float64], n: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """The nearest labels in play of each point, nearest first.

        Args:
            points_m: Points [m], shape (N, 3).
            n: Number of neighbours; fewer where fewer are in play.

        Returns:
            Their distances [m], shape (N, n), their points [m], shape (N, n, 3), and which are tumour, shape (N, n).
        """
        in_play_m, in_play_tumour = self.points_m[self.is_in_play], self.is_tumour[self.is_in_play]
        if self._tree is None:
            self._tree = KDTree(in_play_m)
        # A list of neighbours keeps the shape (N, n) where n is 1; the stubs know only a number.
        ranks: list[int] = [*range(1, min(n, len(in_play_m)) + 1)]
        distance_m, nearest = self._tree.query(points_m, k=ranks)  # pyright: ignore[reportArgumentType]
        return distance_m, in_play_m[nearest], in_play_tumour[nearest]

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
        return LabelledPoints(reading.points_m[is_kept], reading.is_occupied[is_kept])

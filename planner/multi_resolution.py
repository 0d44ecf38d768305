"""The multi-resolution baseline of the paper: coarse to fine, one sensing action per cell."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from .planner import Planner
from .situation import Situation
from .workspace import Workspace

FINEST_ROUND = 15
"""The round from which rounds get no finer: 2^15 cells a side are some 10 micrometres wide each on an organ."""


@dataclass(frozen=True)
class MultiResolution(Planner):
    """Divides the workspace's bounding box in x and y into 4^r cells in round r = 0, 1, 2, ...

    Each cell gets one sensing action, at the pose nearest to its centre, in raster order (x runs fastest), and then the
    next round starts. A cell without a pose that the arm reaches is passed over, so that no round holds a pose twice.
    Once the cells are finer than the poses, a round repeats the poses of the round before; the finest repeats for ever.
    """

    preferred_map: ClassVar[Literal["paper", "calibrated"]] = "paper"
    needs_belief: ClassVar[bool] = False

    def rank(self, situation: Situation) -> Iterator[int]:
        """The round's poses, cell by cell from the next cell on, each cell's by distance from its centre.

        See `Planner.rank`.
        """
        is_available = situation.available(exclude_sensed=False)
        if not is_available.any():
            return
        n_left = len(situation.sensed)
        for round_index in itertools.count():
            order, cells = raster_of_round(situation.workspace, min(round_index, FINEST_ROUND))
            is_left = is_available[order]
            starts = _starts_of_runs(cells[is_left])
            if n_left < len(starts):
                yield from map(int, np.roll(order[is_left], -starts[n_left]))
                return
            n_left -= len(starts)


# Kept, since every step needs all rounds up to its own; a workspace never changes.
@lru_cache(maxsize=2 * FINEST_ROUND)
def raster_of_round(workspace: Workspace, round_index: int) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """The poses sorted by cell in raster order, then by distance from the cell's centre, and their cells.

    Args:
        workspace: The poses.
        round_index: The round r, from 0; it has 2^r cells along x and along y.

    Returns:
        Pose indices, shape (N,), and the cell of each of them, shape (N,).
    """
    n_side = 2**round_index
    xy_m = workspace.positions_m[:, :2]
    low_m = xy_m.min(axis=0)
    # A single row of poses has no width.
    size_m = np.maximum(xy_m.max(axis=0) - low_m, np.finfo(np.float64).tiny)
    column_row = np.minimum((xy_m - low_m) / size_m * n_side, n_side - 1).astype(np.int64)
    centres_m = low_m + (column_row + 0.5) * size_m / n_side
    distances_m = np.linalg.norm(xy_m - centres_m, axis=1)
    cells = column_row[:, 1] * n_side + column_row[:, 0]
    order = np.lexsort((distances_m, cells))
    sorted_cells = cells[order]
    for array in (order, sorted_cells):
        array.setflags(write=False)
    return order, sorted_cells


def _starts_of_runs(values: NDArray[np.int64]) -> NDArray[np.intp]:
    """The place at which each run of equal values begins, shape (number of runs,)."""
    return np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))

"""The multi-resolution baseline of the paper: coarse to fine, one sensing action per cell."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from .planner import Planner
from .situation import Situation
from .workspace import Workspace

FINEST_ROUND = 15
"""Rounds stop getting finer here: 2^15 cells a side are 10 micrometres each on an organ."""


@dataclass(frozen=True)
class MultiResolution(Planner):
    """Divides the workspace's bounding box in x and y into 4^r cells in round r = 0, 1, 2, ...

    Each cell gets one sensing action, from its pose nearest to its centre, in raster order (x runs fastest);
    then the next round starts. A cell without a pose that the arm reaches is passed, so no round holds a pose
    twice; once the cells are finer than the poses, rounds repeat the poses of the round before. The finest
    round repeats for ever.
    """

    needs_belief: ClassVar[bool] = False

    def rank(self, situation: Situation) -> Iterator[int]:
        """The round's poses, cell by cell from the next cell on, each cell's by distance from its centre."""
        is_available = situation.available(exclude_sensed=False)
        if not is_available.any():
            return
        round_index, cell_rank = _find_turn(situation.workspace, is_available, len(situation.sensed))
        cells, distances_m = cells_of_round(situation.workspace, round_index)
        available = np.flatnonzero(is_available)
        order = available[np.lexsort((distances_m[available], cells[available]))]
        occupied_cells = np.unique(cells[available])
        start = int(np.searchsorted(cells[order], occupied_cells[cell_rank]))
        yield from np.roll(order, -start).tolist()


def cells_of_round(workspace: Workspace, round_index: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Each pose's cell in a round, and its distance from the cell's centre in x and y [m], both (N,).

    Args:
        workspace: The poses.
        round_index: The round r, from 0; it has 2^r cells along x and along y, numbered in raster order.
    """
    n_side = 2 ** min(round_index, FINEST_ROUND)
    xy_m = workspace.positions_m[:, :2]
    low_m = xy_m.min(axis=0)
    size_m = np.maximum(
        xy_m.max(axis=0) - low_m, np.finfo(np.float64).tiny
    )  # a single row of poses has no width
    column_row = np.minimum((xy_m - low_m) / size_m * n_side, n_side - 1).astype(np.int64)
    centres_m = low_m + (column_row + 0.5) * size_m / n_side
    distances_m = np.linalg.norm(xy_m - centres_m, axis=1)
    return column_row[:, 1] * n_side + column_row[:, 0], distances_m


def _find_turn(workspace: Workspace, is_available: NDArray[np.bool_], n_sensed: int) -> tuple[int, int]:
    """The round of the next sensing action, and the number of its occupied cells that come before."""
    round_index = 0
    while True:
        cells, _ = cells_of_round(workspace, round_index)
        n_occupied = len(np.unique(cells[is_available]))
        if n_sensed < n_occupied:
            return round_index, n_sensed
        n_sensed -= n_occupied
        if round_index >= FINEST_ROUND:
            return round_index, n_sensed % n_occupied
        round_index += 1

"""The boustrophedon: rows over the reachable surface, there and back as the ox ploughs, then finer ones.

Choset, Coverage of known spaces: the boustrophedon cellular decomposition, Autonomous Robots 9, 2000. An organ's upper
surface is one cell here; rows that a hole interrupts go on behind it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..errors import PlannerError
from ..situation import Situation
from ..workspace import Workspace
from .path_planner import PathPlanner

_N_ROUNDS = 4
"""Rasters, each with rows half as far apart as the one before."""
_LEAST_ROW_M = 0.002
"""No rows lie closer [m]."""


@dataclass(frozen=True, kw_only=True)
class Boustrophedon(PathPlanner):
    """Goes over the surface row by row along its longest direction; where all rows are done, over rows between them."""

    needs_belief: ClassVar[bool] = False

    row_share: float = 1.0
    """Distance between rows of the first raster, as a share of the radius of the cone's base."""
    stretch_m: float = 0.06
    """Length of the piece of a row that is one path [m]."""

    def __post_init__(self) -> None:
        """Checks the ranges."""
        for name in ("row_share", "stretch_m"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise PlannerError(f"`{name}` must be above 0 and finite, got {getattr(self, name)}")

    def paths(self, situation: Situation) -> Iterator[tuple[int, ...]]:
        """The next piece of the raster, and those after it where its end is not reached. See `Planner.paths`."""
        row_m = max(self.row_share * situation.cone.base_radius_m, _LEAST_ROW_M)
        gone = {*situation.sensed, *situation.skipped}
        for number in range(_N_ROUNDS):
            for row in rows_of(situation.workspace, max(row_m / 2**number, _LEAST_ROW_M)):
                left = [pose for pose in row if pose not in gone]
                yield from self._pieces(situation.workspace, left)

    def _pieces(self, workspace: Workspace, row: list[int]) -> Iterator[tuple[int, ...]]:
        """A row in pieces of the length of a path."""
        piece: list[int] = []
        gone_m = 0.0
        for pose in row:
            if piece:
                gone_m += float(
                    np.linalg.norm(workspace.positions_m[pose] - workspace.positions_m[piece[-1]])
                )
            piece.append(pose)
            if gone_m >= self.stretch_m:
                yield tuple(piece)
                piece, gone_m = [], 0.0
        if piece:
            yield tuple(piece)


@lru_cache(maxsize=2 * _N_ROUNDS)
def rows_of(workspace: Workspace, row_m: float) -> tuple[tuple[int, ...], ...]:
    """The rows of a raster, each the poses by which it goes, every second row backwards.

    The poses lie within half a row of the places of a square grid in the plane in which the workspace is widest.

    Args:
        workspace: The poses.
        row_m: Distance between rows, and between the places along one [m].
    """
    flat_m = _in_plane(workspace.positions_m)
    low_m, high_m = flat_m.min(axis=0), flat_m.max(axis=0)
    along, across = (
        np.arange(low + min(row_m, high - low) / 2.0, high + 1e-9, row_m)
        for low, high in zip(low_m, high_m, strict=True)
    )
    tree, rows = KDTree(flat_m), []
    for number, height in enumerate(across):
        places = np.column_stack([along if number % 2 == 0 else along[::-1], np.full(len(along), height)])
        away_m, nearest = tree.query(places)
        row = dict.fromkeys(int(pose) for pose in np.asarray(nearest)[np.asarray(away_m) <= row_m / 2.0])
        rows.append(tuple(row))
    return tuple(rows)


def _in_plane(positions_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coordinates in the plane of the two longest principal axes, the longest first [m], shape (N, 2)."""
    centred_m = positions_m - positions_m.mean(axis=0)
    axes = np.linalg.svd(centred_m, full_matrices=False)[2][:2]
    # The sign of an axis is arbitrary: each points to where its largest component is positive.
    axes *= np.sign(axes[np.arange(len(axes)), np.abs(axes).argmax(axis=1)])[:, None]
    return centred_m @ axes.T

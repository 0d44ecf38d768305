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
    """Goes over the surface row by row along the longest side of its rectangle; then over rows between these."""

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
        workspace = situation.workspace
        row_m = max(self.row_share * situation.cone.base_radius_m, _LEAST_ROW_M)
        gone = KDTree(workspace.positions_m[list(situation.sensed)]) if situation.sensed else None
        for number in range(_N_ROUNDS):
            apart_m = max(row_m / 2**number, _LEAST_ROW_M)
            for row in rows_of(workspace, apart_m, max(self.stretch_m, apart_m)):
                stops = [pose for pose in row if pose not in situation.skipped]
                places_m = workspace.positions_m[stops].reshape(-1, 3)
                is_gone = np.zeros(len(stops), dtype=bool)
                if gone is not None and stops:
                    is_gone = np.asarray(gone.query(places_m)[0]) <= apart_m / 2.0
                yield from ((stops[index],) for index in np.flatnonzero(~is_gone))


@lru_cache(maxsize=2 * _N_ROUNDS)
def rows_of(workspace: Workspace, row_m: float, stretch_m: float) -> tuple[tuple[int, ...], ...]:
    """The rows of a raster, each the poses by which it goes, every second row backwards.

    The poses lie within half a row of the places of a grid in the plane in which the workspace is widest; of those of a
    row its two ends are kept, and one each stretch.

    Args:
        workspace: The poses.
        row_m: Distance between rows [m].
        stretch_m: Distance between the poses along one [m].
    """
    flat_m = _in_plane(workspace.positions_m)
    low_m, high_m = flat_m.min(axis=0), flat_m.max(axis=0)
    along, across = (_middles(low, high, row_m) for low, high in zip(low_m, high_m, strict=True))
    tree, rows = KDTree(flat_m), []
    for number, height in enumerate(across):
        places = np.column_stack([along if number % 2 == 0 else along[::-1], np.full(len(along), height)])
        away_m, nearest = tree.query(places)
        row = [*dict.fromkeys(int(pose) for pose in np.asarray(nearest)[np.asarray(away_m) <= row_m / 2.0])]
        every = max(1, round(stretch_m / row_m))
        rows.append(tuple(dict.fromkeys([*row[::every], *row[-1:]])))
    return tuple(rows)


def _middles(low: float, high: float, width: float) -> NDArray[np.float64]:
    """The middles of the fewest even parts of a range that are no wider than a width."""
    n = max(1, int(np.ceil((high - low) / width - 1e-9)))
    return low + (np.arange(n) + 0.5) * (high - low) / n


def _in_plane(positions_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coordinates in the plane in which the positions are widest, along the smallest rectangle [m], shape (N, 2)."""
    centred_m = positions_m - positions_m.mean(axis=0)
    normal = np.linalg.svd(centred_m, full_matrices=False)[2][-1]
    x = np.eye(3)[np.abs(normal).argmin()]
    x = (x - (x @ normal) * normal) / np.linalg.norm(x - (x @ normal) * normal)
    flat_m = centred_m @ np.column_stack([x, np.cross(normal, x)])
    turns_rad = np.deg2rad(np.arange(0.0, 180.0, 1.0))
    # As wide as can be along the rows, among the rectangles that are as small as the smallest but for rounding.
    sizes_m = np.array([np.ptp(flat_m @ _turn(turn), axis=0) for turn in turns_rad])
    areas_m2 = sizes_m.prod(axis=1)
    is_small = areas_m2 <= areas_m2.min() * (1.0 + 1e-6)
    best = int(np.argmax(np.where(is_small, sizes_m[:, 0], 0.0)))
    return flat_m @ _turn(turns_rad[best])


def _turn(angle_rad: float) -> NDArray[np.float64]:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])

"""The connected components of what a map calls tumour, named pieces, and the tumours that each of them touches."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label
from scipy.spatial import KDTree

from sim.record.map_field import MapField
from sim.world.solids.solid import Solid

from .mapped_surface import Grid

LEAST_POINTS = 2
"""Lattice points that a map has to call tumour in or next to a tumour for it to be found: one has no extent."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """What a map calls tumour, piece by piece, and which tumours each piece is a finding of."""

    field: MapField
    level: float
    """Log-odds from which a point is called tumour."""
    organ: Solid
    labels: NDArray[np.intp]
    """The piece of each lattice point, from 1; 0 where none is. Shape (X, Y, Z)."""
    touches: NDArray[np.bool_]
    """Which piece touches which tumour, shape (number of pieces + 1, number of tumours); row 0 stands for no piece."""
    is_found: NDArray[np.bool_]
    """Which tumours are found, shape (number of tumours,): pieces hold at least `LEAST_POINTS` of the lattice points
    nearest to their points, or all of these where there are fewer."""
    tumour_points_m: NDArray[np.float64]
    """Points in the tumours, shape (D, 3)."""
    tumour_of_point: NDArray[np.int64]
    """The tumour of each of these points, from 0, shape (D,)."""

    @classmethod
    def of(
        cls,
        field: MapField,
        level: float,
        organ: Solid,
        tumour_points_m: NDArray[np.float64],
        tumour_of_point: NDArray[np.int64],
        n_tumours: int,
    ) -> Pieces:
        """The pieces of what a field calls tumour.

        A piece touches a tumour where the lattice point nearest to one of the tumour's points belongs to it.
        """
        is_called = (field.log_odds > level) & field.is_inside
        # SciPy's types do not say that this is a pair of labels and their count.
        labelled: Any = label(is_called, structure=np.ones((3, 3, 3)))
        labels, n_pieces = np.asarray(labelled[0], dtype=np.intp), int(labelled[1])
        touches = np.zeros((n_pieces + 1, n_tumours), dtype=bool)
        touches[labels[tuple(field.nearest(tumour_points_m).T)], tumour_of_point] = True
        touches[0] = False
        is_found = np.zeros(n_tumours, dtype=bool)
        for tumour in range(n_tumours):
            cells = np.unique(field.nearest(tumour_points_m[tumour_of_point == tumour]), axis=0)
            n_called = int((labels[tuple(cells.T)] > 0).sum())
            is_found[tumour] = n_called >= max(min(LEAST_POINTS, len(cells)), 1)
        return cls(field, level, organ, labels, touches, is_found, tumour_points_m, tumour_of_point)

    @property
    def false(self) -> list[int]:
        """The pieces that touch no tumour."""
        return [piece for piece in range(1, len(self.touches)) if not self.touches[piece].any()]

    def is_of(
        self, points_m: NDArray[np.float64], *, tumour: int | None = None, piece: int | None = None
    ) -> NDArray[np.bool_]:
        """Which points belong to what was mapped of a tumour, or to one piece, whatever their value is, shape (N,).

        A point belongs to the piece of the nearest lattice point that is called tumour. Where that piece touches
        several tumours, it belongs to the tumour whose points are nearest.
        """
        owner = self.nearest_piece[tuple(self.field.nearest(points_m).T)]
        if piece is not None:
            return owner == piece
        claims = self.touches[owner, tumour]
        shared = claims & (self.touches[owner].sum(axis=1) > 1)
        if shared.any():
            nearest = self.tumour_of_point[self._tree.query(points_m[shared])[1]]
            claims[shared] = nearest == tumour
        return claims

    def values(self, grid: Grid, belongs: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The field less its level at the grid's points that belong and lie in the organ, below 0 elsewhere, (N,)."""
        values = self.field.at(grid.points_m()) - self.level
        is_left_out = (values > 0) & ~(belongs & grid.is_in(self.organ))
        return np.where(is_left_out, -np.maximum(values, 0.01), values)

    def box_of(self, is_mapped: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The corners of the box around the cells of lattice points; None where there are no such points."""
        if not is_mapped.any():
            return None
        indices = np.nonzero(is_mapped)
        low = np.array([axis[i.min()] for axis, i in zip(self.field.axes_m, indices, strict=True)])
        high = np.array([axis[i.max()] for axis, i in zip(self.field.axes_m, indices, strict=True)])
        return low - self.field.cell_m, high + self.field.cell_m

    @cached_property
    def nearest_piece(self) -> NDArray[np.intp]:
        """The piece of the nearest lattice point that is called tumour, shape (X, Y, Z); 0 without any such point."""
        if not self.labels.any():
            return self.labels
        _, nearest = distance_transform_edt(
            self.labels == 0, sampling=_positive(self.field.cell_m), return_indices=True
        )  # pyright: ignore[reportGeneralTypeIssues]
        return self.labels[tuple(nearest)]

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.tumour_points_m)


def grid_around(*boxes: tuple[NDArray[np.float64], NDArray[np.float64]] | None) -> Grid:
    """The grid over all boxes, of which those that are None are left out."""
    kept = [box for box in boxes if box is not None]
    return Grid.around(np.min([low for low, _ in kept], axis=0), np.max([high for _, high in kept], axis=0))


def _positive(cell_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(cell_m > 0, cell_m, 1.0)

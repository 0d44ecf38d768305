"""Which tissue lies where: a grid of labels with smooth boundaries, cut once from the surfaces of a scene.

A node holds the label that fills most of the cell about it, and by how much that is more than half of it, its margin.
At a point between nodes each label adds up the margins of the corners that have it, weighted as in trilinear
interpolation, and the label with the largest sum is the point's. Where two labels meet this is the level set of the
share that one of them fills: boundaries are smooth to a fraction of the spacing, and no label needs its own field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_cdt

from sim.errors import FieldError
from sim.world.anatomy.anatomy import Anatomy
from sim.world.memory import spare_bytes
from sim.world.meshes.topology import is_closed
from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import SurfaceDistance

from .tissues import DEFAULT_STRUCTURE, Tissue

MIXED = 255
"""What `cells` says where corners differ."""
BYTES_PER_NODE = 24
"""Memory that a node takes while the grid is cut."""
ROOM_M = 0.012
"""How far the grid reaches beyond the organ [m]."""
SUBSAMPLES = 2
"""Points along each edge of a node's cell by which its share is counted."""
LEAST_MARGIN = 1e-3
"""A node on the boundary itself still belongs to one side of it."""


@dataclass(frozen=True, eq=False)
class LabelGrid:
    """Labels on the nodes of a grid in the frame of the tissue, which is the world's while the organ lies still."""

    tissues: tuple[Tissue, ...]
    """The tissue of each label. Label 0 is all that lies about the organ, and fills what the grid does not reach."""
    labels: NDArray[np.uint8]
    """Label of each node, shape (X, Y, Z)."""
    margins: NDArray[np.float32]
    """How much more than half of its cell each node's label fills, above 0 and at most 1/2, shape (X, Y, Z)."""
    cells: NDArray[np.uint8]
    """The label of all corners of each cell, or `MIXED`, shape (X - 1, Y - 1, Z - 1)."""
    rooms: NDArray[np.uint8]
    """How many cells around each, itself included, have its label for certain: 0 of a mixed one, at most 255, in its
    shape. Within `rooms - 1` spacings of any place of the cell the label is the same."""
    origin_m: NDArray[np.float64]
    """The first node [m], shape (3,)."""
    spacing_m: float
    """Distance of the nodes [m]."""

    @classmethod
    def from_labels(
        cls,
        tissues: Sequence[Tissue],
        labels: NDArray[np.uint8],
        margins: NDArray[np.float32] | None = None,
        *,
        origin_m: NDArray[np.float64],
        spacing_m: float,
    ) -> LabelGrid:
        """The grid of labels that are at hand.

        Args:
            tissues: The tissue of each label.
            labels: Label of each node, shape (X, Y, Z).
            margins: How much more than half of its cell each label fills; None for all of it.
            origin_m: The first node [m], shape (3,).
            spacing_m: Distance of the nodes [m].
        """
        if margins is None:
            margins = np.full(labels.shape, 0.5, dtype=np.float32)
        cells = _cells_of(labels)
        origin_m = np.asarray(origin_m, dtype=np.float64)
        return cls(tuple(tissues), labels, margins, cells, _rooms_of(cells), origin_m, spacing_m)


def cut_grid(
    anatomy: Anatomy,
    *,
    surroundings: Tissue,
    organ: Tissue,
    lesions: Sequence[tuple[Solid, Tissue]],
    target: Tissue,
    structures: Sequence[Tissue],
    spacing_m: float = 0.001,
) -> LabelGrid:
    """The grid of an anatomy.

    Tumours and the bodies of a second class count as far as they lie in the organ. A structure lies over all of them
    where its tissue is known, as a vessel or a clip is, and below them where it is only `DEFAULT_STRUCTURE`, as a
    segment of the organ is.

    Args:
        anatomy: What to cut, world frame.
        surroundings: The tissue about the organ.
        organ: The organ's tissue.
        lesions: The bodies of the tumours, each with its tissue; a later one lies over an earlier one.
        target: The tissue of the bodies of a second class.
        structures: The tissue of each of the anatomy's structures.
        spacing_m: Distance of the nodes [m].

    Raises:
        FieldError: The grid does not fit memory.
    """
    low_m, high_m = anatomy.organ.bounds_m + ROOM_M * np.array([[-1.0], [1.0]])
    shape = np.ceil((high_m - low_m) / spacing_m).astype(int) + 2
    if BYTES_PER_NODE * float(np.prod(shape.astype(float))) > spare_bytes():
        size = " x ".join(map(str, shape))
        raise FieldError(
            "tissue_spacing_mm", spacing_m * 1e3, f"{size} nodes do not fit memory; name a larger one."
        )
    painter = _Painter(low_m, spacing_m, (int(shape[0]), int(shape[1]), int(shape[2])))
    tissues = [surroundings, organ]
    painter.paint(anatomy.organ, 1)
    is_organ = painter.labels == 1
    by_name = list(zip(anatomy.structures, structures, strict=True))
    below = [(each.solid, tissue) for each, tissue in by_name if tissue.name == DEFAULT_STRUCTURE]
    above = [(each.solid, tissue) for each, tissue in by_name if tissue.name != DEFAULT_STRUCTURE]
    targets = anatomy.target.tumours if anatomy.target is not None else ()
    inner = [*lesions, *((solid, target) for solid in targets)]
    for bodies, within in ((below, None), (inner, is_organ), (above, None)):
        for solid, tissue in bodies:
            if tissue not in tissues:
                tissues.append(tissue)
            painter.paint(solid, tissues.index(tissue), within=within)
    return LabelGrid.from_labels(
        tissues, painter.labels, painter.margins, origin_m=low_m, spacing_m=spacing_m
    )


class _Painter:
    """A grid on which one body after the other is laid over what lies there."""

    def __init__(self, origin_m: NDArray[np.float64], spacing_m: float, shape: tuple[int, int, int]) -> None:
        self._origin_m, self._spacing_m = origin_m, spacing_m
        self.labels = np.zeros(shape, dtype=np.uint8)
        self.margins = np.full(shape, 0.5, dtype=np.float32)

    def paint(self, solid: Solid, label: int, *, within: NDArray[np.bool_] | None = None) -> None:
        """Lay a body over what is there; only on the nodes `within`, if they are given."""
        low, high = ((solid.bounds_m - self._origin_m) / self._spacing_m).round().astype(int)
        first = np.clip(low - 1, 0, self.labels.shape)
        last = np.clip(high + 2, 0, self.labels.shape)
        if (first >= last).any():
            return
        box = tuple(slice(int(a), int(b)) for a, b in zip(first, last, strict=True))
        share = (
            self._shares(solid, first, last) if is_closed(solid.faces) else self._shell(solid, first, last)
        )
        labels, margins = self.labels[box], self.margins[box]
        is_body = share >= 0.5
        if within is not None:
            is_body &= within[box]
        # Bodies of one tissue that overlap are one body.
        is_same = labels == label
        inside = np.maximum(share - 0.5, np.where(is_same, margins, LEAST_MARGIN))
        outside = np.where(is_same, margins, np.minimum(margins, np.maximum(0.5 - share, LEAST_MARGIN)))
        margins[...] = np.where(is_body, inside, outside)
        labels[is_body] = label

    def _shares(self, solid: Solid, first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.float32]:
        """The share of each node's cell that a body fills, in a box of nodes."""
        offsets = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
        axes_m = [
            self._origin_m[i] + self._spacing_m * (np.arange(first[i], last[i])[:, None] + offsets).ravel()
            for i in range(3)
        ]
        shape = tuple(int(b - a) for a, b in zip(first, last, strict=True))
        share = np.empty(shape, dtype=np.float32)
        # Slab by slab: the points of a whole organ would take gigabytes.
        for i in range(shape[0]):
            x_m = axes_m[0][i * SUBSAMPLES : (i + 1) * SUBSAMPLES]
            places_m = np.stack(np.meshgrid(x_m, axes_m[1], indexing="ij"), axis=-1).reshape(-1, 2)
            is_in = solid.contains_in_columns(places_m, axes_m[2])
            parts = is_in.reshape(SUBSAMPLES, shape[1], SUBSAMPLES, shape[2], SUBSAMPLES)
            share[i] = parts.mean(axis=(0, 2, 4), dtype=np.float32)
        return share

    def _shell(self, solid: Solid, first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.float32]:
        """1 for each node nearer to an open surface than the spacing, which has no inside, and 0 for all others."""
        axes_m = [self._origin_m[i] + self._spacing_m * np.arange(first[i], last[i]) for i in range(3)]
        nodes_m = np.stack(np.meshgrid(*axes_m, indexing="ij"), axis=-1)
        distance_m = SurfaceDistance(solid).distance_m(nodes_m.reshape(-1, 3))
        return (distance_m < self._spacing_m).astype(np.float32).reshape(nodes_m.shape[:3])


def _cells_of(labels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The label that all corners of a cell share, or `MIXED`."""
    cells = labels[:-1, :-1, :-1].copy()
    nx, ny, nz = cells.shape
    is_mixed = np.zeros(cells.shape, dtype=bool)
    for i, j, k in np.ndindex(2, 2, 2):
        is_mixed |= labels[i : i + nx, j : j + ny, k : k + nz] != cells
    cells[is_mixed] = MIXED
    return cells


def _rooms_of(cells: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The distance of each cell to the nearest mixed one or to the grid's end, in steps that may go by corners too."""
    is_sure = np.pad(cells != MIXED, 1)
    steps = np.asarray(distance_transform_cdt(is_sure, metric="chessboard"))
    return np.minimum(steps[1:-1, 1:-1, 1:-1], 255).astype(np.uint8)

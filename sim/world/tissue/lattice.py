"""The lattice of cubes that an organ is laid into: its cells, their nodes, and values between these."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label
from scipy.sparse import csr_array

from sim.world.errors import TissueError
from sim.world.solids.solid import Solid

from .brick import CORNERS, SUBCELLS
from .dissection import nested_dissection

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MEAN_CELLS = 800
"""Cells that the organ's volume makes where nobody sets their size: a press then takes some 4 ms."""
MOST_CELLS = 20_000
"""More cells with tissue in them than this take minutes to factorise."""
MOST_BOX_CELLS = 1_000_000
"""More cells over the organ's bounding box than this take gigabytes."""
LEAST_VOLUME_SHARE = 0.5
"""Less of the organ's volume than this on the lattice means that its parts are thinner than the lattice can hold."""


@dataclass(frozen=True, eq=False)
class Lattice:
    """Cubes over an organ's bounding box.

    Attributes:
        origin_m: Lowest corner [m], shape (3,).
        size_m: Edge of a cell [m].
        shape: Number of cells along each axis, shape (3,).
        is_cell: Which cells hold some of the organ, shape (nx, ny, nz).
    """

    origin_m: Array
    size_m: float
    shape: Indices
    is_cell: NDArray[np.bool_]

    @cached_property
    def cells(self) -> Indices:
        """The cells that hold some of the organ, by their places, shape (C, 3)."""
        return np.argwhere(self.is_cell)

    @cached_property
    def cell_parts(self) -> Indices:
        """To which part of the organ each cell of the box belongs, parts sharing no corner, shape (nx, ny, nz)."""
        parts = np.zeros(self.is_cell.shape, dtype=np.int64)
        label(self.is_cell, structure=np.ones((3, 3, 3)), output=parts)
        return parts

    @cached_property
    def nodes(self) -> Indices:
        """The nodes of the cells as numbers within the box, in the order of the factorisation, shape (N,)."""
        used = np.unique(self._corner_nodes(self.cells))
        return used[nested_dissection(np.stack(np.unravel_index(used, self.shape + 1), axis=-1))]

    @cached_property
    def rows(self) -> Indices:
        """Row of each node of the box among `nodes`, that of the nearest node for one without a cell, shape (B,)."""
        rows = np.full(np.prod(self.shape + 1), -1)
        rows[self.nodes] = np.arange(len(self.nodes))
        is_unused = (rows < 0).reshape(self.shape + 1)
        nearest = np.zeros((3, *is_unused.shape), dtype=np.int32)
        distance_transform_edt(is_unused, return_distances=False, return_indices=True, indices=nearest)
        return rows.reshape(self.shape + 1)[tuple(nearest)].ravel()

    @cached_property
    def cell_rows(self) -> Indices:
        """Rows of each cell's corners among `nodes`, shape (C, 8)."""
        return self.rows[self._corner_nodes(self.cells)]

    def cell_at(self, points_m: Array) -> Indices:
        """The cell of the box that each point lies in, or is nearest to, shape (P, 3)."""
        return np.clip(np.floor((points_m - self.origin_m) / self.size_m).astype(np.int64), 0, self.shape - 1)

    def weights(self, points_m: Array) -> csr_array:
        """Trilinear interpolation from `nodes` to points in the organ, shape (P, N)."""
        nodes, weights = self._corners(points_m)
        start = np.arange(0, 8 * len(points_m) + 1, 8)
        return csr_array((weights.ravel(), self.rows[nodes].ravel(), start), (len(points_m), len(self.nodes)))

    def on_box(self, values: Array) -> Array:
        """Values of `nodes` at all nodes of the box, those without a cell taking their nearest one's, shape (B, 3)."""
        return values[self.rows]

    def interpolate(self, on_box: Array, points_m: Array) -> Array:
        """Trilinear interpolation of what `on_box` returned, continued evenly beyond the box, shape (P, 3)."""
        nodes, weights = self._corners(points_m)
        result = np.zeros((len(points_m), 3))
        for corner in range(8):
            result += weights[:, corner, None] * on_box[nodes[:, corner]]
        return result

    def _corners(self, points_m: Array) -> tuple[Indices, Array]:
        """Nodes of the box about each point and their weights, each of shape (P, 8)."""
        scaled = np.clip((points_m - self.origin_m) / self.size_m, 0.0, self.shape)
        cells = np.minimum(scaled.astype(np.int64), self.shape - 1)
        along = scaled - cells
        sides = np.stack([1.0 - along, along], axis=-1)
        weights = sides[:, 0, :, None, None] * sides[:, 1, None, :, None] * sides[:, 2, None, None, :]
        return self._corner_nodes(cells), weights.reshape(-1, 8)

    def _corner_nodes(self, cells: Indices) -> Indices:
        strides = np.array([(self.shape[1] + 1) * (self.shape[2] + 1), self.shape[2] + 1, 1])
        return (cells @ strides)[:, None] + CORNERS @ strides


def cell_size_m(organ: Solid, size_m: float | None) -> float:
    """The edge of the cells of an organ's lattice [m]; None takes the size that suits it.

    Raises:
        TissueError: Cells so small that there would be too many, or an organ without volume.
    """
    volume_m3, box_m3 = organ.volume_m3, float(np.prod(organ.extents_m))
    if not volume_m3 > 0.0:
        raise TissueError(f"the organ's volume is {1e6 * volume_m3:.3g} ml: its triangles must face outwards")
    if size_m is None:
        return float(np.cbrt(max(volume_m3 / MEAN_CELLS, box_m3 / MOST_BOX_CELLS)))
    if box_m3 > MOST_BOX_CELLS * size_m**3:
        raise TissueError(_too_many(size_m, f"{box_m3 / size_m**3:.2g} cells over the organ's box"))
    if volume_m3 > MOST_CELLS * size_m**3:
        raise TissueError(_too_many(size_m, f"more than {volume_m3 / size_m**3:.0f} cells"))
    return size_m


def lay_lattice(organ: Solid, surface_points_m: Array, size_m: float) -> tuple[Lattice, NDArray[np.bool_]]:
    """The lattice over an organ, and which sub-cubes of its cells lie inside, shape (C, SUBCELLS^3).

    Args:
        organ: The organ.
        surface_points_m: Points on its surface [m], shape (P, 3); cells that hold one are kept, however little of the
            organ they hold.
        size_m: Edge of a cell [m].

    Raises:
        TissueError: The cells are more than can be factorised, or too large to hold the organ.
    """
    low, high = organ.bounds_m
    shape = np.maximum(np.ceil((high - low) / size_m - 1e-9), 1).astype(np.int64)
    origin_m = 0.5 * (low + high) - 0.5 * shape * size_m
    bare = Lattice(origin_m, size_m, shape, np.zeros(shape, dtype=np.bool_))
    is_inside = inside_cells(organ, bare)
    is_cell = np.asarray(is_inside.any(axis=-1))
    is_cell[tuple(bare.cell_at(surface_points_m).T)] = True
    if is_cell.sum() > MOST_CELLS:
        raise TissueError(_too_many(size_m, f"{is_cell.sum()} cells"))
    on_lattice_m3 = is_inside.sum() * (size_m / SUBCELLS) ** 3
    if on_lattice_m3 < LEAST_VOLUME_SHARE * organ.volume_m3:
        raise TissueError(
            f"of the organ's {1e6 * organ.volume_m3:.3g} ml, {1e6 * on_lattice_m3:.3g} ml lie on a lattice of "
            f"{1e3 * size_m:.3g} mm: its parts are thinner than the cells; set element_size_m to twice their thickness"
        )
    return Lattice(origin_m, size_m, shape, is_cell), is_inside[is_cell]


def inside_cells(solid: Solid, lattice: Lattice) -> NDArray[np.bool_]:
    """Which sub-cubes of each cell of the box have their middle in a solid, shape (nx, ny, nz, SUBCELLS^3)."""
    step_m = lattice.size_m / SUBCELLS
    x_m, y_m, z_m = (
        lattice.origin_m[axis] + step_m * (np.arange(SUBCELLS * lattice.shape[axis]) + 0.5)
        for axis in range(3)
    )
    places_m = np.stack(np.meshgrid(x_m, y_m, indexing="ij"), axis=-1).reshape(-1, 2)
    nx, ny, nz = (int(n) for n in lattice.shape)
    is_inside = solid.contains_in_columns(places_m, z_m).reshape(nx, SUBCELLS, ny, SUBCELLS, nz, SUBCELLS)
    return is_inside.transpose(0, 2, 4, 1, 3, 5).reshape(nx, ny, nz, SUBCELLS**3)


def _too_many(size_m: float, count: str) -> str:
    return f"element_size_m={size_m:.3g} makes {count}, and {MOST_CELLS} can hold tissue: set a larger one"

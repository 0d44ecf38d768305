"""Thinning of meshes that are only looked at: by collapsing edges or, where that fails, on a grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from sim.world.solids.solid import Solid

Surface = tuple[NDArray[np.float64], NDArray[np.int64]]
LEAST_FACES = 500
"""Least triangles of each of several surfaces: with fewer, a surface would no longer be recognised."""


def thinned_together(solids: Sequence[Solid], most_faces: int) -> list[Surface]:
    """Surfaces that have `most_faces` triangles together, of which each keeps its share; none is left empty."""
    n_faces = sum(len(solid.faces) for solid in solids)
    shares = [max(len(solid.faces) * most_faces // n_faces, LEAST_FACES) for solid in solids]
    return [thinned(each.vertices_m, each.faces, share) for each, share in zip(solids, shares, strict=True)]


def thinned(vertices_m: NDArray[np.float64], faces: NDArray[np.int64], most_faces: int) -> Surface:
    """A mesh thinned to about `most_faces` triangles: its vertices [m], shape (V, 3), and faces, shape (F, 3)."""
    if len(faces) <= most_faces:
        return vertices_m, faces
    centre_m = vertices_m.mean(axis=0)
    centred_mm = np.ascontiguousarray((vertices_m - centre_m) * 1e3, dtype=np.float32)
    # Releases of the package differ in whether they declare the types of this function.
    simplify: Any = fast_simplification.simplify
    points_mm, triangles = simplify(
        centred_mm, np.ascontiguousarray(faces, dtype=np.int32), target_count=most_faces
    )
    if not len(triangles):
        return _drawn_together(vertices_m, faces, most_faces)
    return np.asarray(points_mm, dtype=np.float64) * 1e-3 + centre_m, np.asarray(triangles, dtype=np.int64)


def _drawn_together(vertices_m: NDArray[np.float64], faces: NDArray[np.int64], most_faces: int) -> Surface:
    """A mesh whose vertices in each cell of a grid are drawn together; the grid is the finest that thins enough."""
    low, extent = vertices_m.min(axis=0), np.ptp(vertices_m, axis=0).max()
    kept = vertices_m, faces
    for n_cells in (256, 192, 128, 96, 64, 32):
        if len(kept[1]) <= most_faces:
            break
        kept = _on_grid(*kept, np.floor((kept[0] - low) / extent * n_cells).astype(np.int64))
    return kept


def _on_grid(vertices_m: NDArray[np.float64], faces: NDArray[np.int64], cells: NDArray[np.int64]) -> Surface:
    """The mean of each cell's vertices, and the triangles that are still triangles."""
    _, cell_of, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    drawn = np.stack([np.bincount(cell_of.ravel(), vertices_m[:, i]) for i in range(3)], axis=1)
    faces = cell_of.ravel()[faces]
    is_flat = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 0] == faces[:, 2])
    return drawn / counts[:, None], faces[~is_flat]

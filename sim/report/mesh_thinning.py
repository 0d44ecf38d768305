"""Thinning of meshes that are only to be looked at, by drawing their vertices together on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def thinned(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int64], most_faces: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A mesh with the vertices of each cell of a grid drawn together, the finest grid that leaves few enough faces."""
    low, extent = vertices_m.min(axis=0), np.ptp(vertices_m, axis=0).max()
    for n_cells in (256, 192, 128, 96, 64, 32):
        if len(faces) <= most_faces:
            break
        cells = np.floor((vertices_m - low) / extent * n_cells).astype(np.int64)
        _, cell_of, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        drawn = np.stack([np.bincount(cell_of.ravel(), vertices_m[:, i]) for i in range(3)], axis=1)
        faces = cell_of.ravel()[faces]
        vertices_m = drawn / counts[:, None]
        is_flat = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 0] == faces[:, 2])
        faces = faces[~is_flat]
    return vertices_m, faces

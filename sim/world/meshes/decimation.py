"""Fewer triangles for the same surface: edges are collapsed where that moves it least (Garland and Heckbert, 1997)."""

from __future__ import annotations

from typing import Any

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from .repair import RepairError, repair
from .topology import is_closed, signed_volume_m3

HASTE = (5.0, 3.0, 1.0)
"""How hastily edges are collapsed (0 to 10), in turn: slower is more even and tears less."""

VOLUME_TOLERANCE = 0.01
"""Share of the volume that a simplified surface may differ by."""


def decimate(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int64], n_triangles: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """The closed surface with at most about so many triangles, or None if it has few already or would tear.

    Args:
        vertices_m: Vertices [m], shape (V, 3).
        faces: Vertex indices of a closed surface, shape (F, 3).
        n_triangles: Triangles wanted.
    """
    if len(faces) <= n_triangles:
        return None
    centre_m = vertices_m.mean(axis=0)
    volume_m3 = signed_volume_m3(vertices_m, faces)
    # Releases of the package differ in whether they declare the types of this function.
    simplify: Any = fast_simplification.simplify
    for haste in HASTE:
        simple, triangles = simplify(
            np.ascontiguousarray((vertices_m - centre_m) * 1e3, dtype=np.float32),
            np.ascontiguousarray(faces, dtype=np.int32),
            target_count=n_triangles,
            agg=haste,
        )
        found_m = np.asarray(simple, dtype=np.float64) * 1e-3 + centre_m
        try:
            found_m, found, _ = repair(found_m, np.asarray(triangles, dtype=np.int64))
        except RepairError:
            continue
        change = abs(signed_volume_m3(found_m, found) / volume_m3 - 1.0)
        if is_closed(found) and change < VOLUME_TOLERANCE:
            return found_m, found
    return None

"""How many lesions were found: the clusters of likely tumour."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label


def n_clusters(points_m: NDArray[np.float64], gap_m: float) -> int:
    """The number of clusters of points; those of two clusters lie in cubes that do not touch.

    Args:
        points_m: Points [m], shape (P, 3).
        gap_m: Side of the cubes [m].
    """
    if not len(points_m):
        return 0
    cubes = np.floor(points_m / gap_m).astype(int)
    cubes -= cubes.min(axis=0)
    is_taken = np.zeros(cubes.max(axis=0) + 1, dtype=bool)
    is_taken[tuple(cubes.T)] = True
    # The stubs know one of the two forms of its result.
    numbered: Any = label(is_taken, structure=np.ones((3, 3, 3)))
    return int(numbered[1])

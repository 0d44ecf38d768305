"""How many lesions were found: the clusters of likely tumour, joined over gaps that the data cannot tell from none."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from mapping import LabelledPoints

from ..cone import Cone

_SPACINGS = 1.5
"""Points of one lesion lie within this many spacings of each other: a diagonal of a lattice's square, and 6 % more."""
_THINNED = 0.25
"""Of points in a cube of this many spacings one is looked at, since a large tumour has tens of thousands."""


def label_spacing_m(cone: Cone, readings: Sequence[LabelledPoints]) -> float:
    """The distance between neighbouring labels [m]: the side of the cube for which a label of a reading stands.

    Args:
        cone: What a reading sees.
        readings: What the sensing actions returned.
    """
    return labels_per_m3(cone, readings) ** (-1.0 / 3.0)


def labels_per_m3(cone: Cone, readings: Sequence[LabelledPoints]) -> float:
    """The number of labels in a volume [1/m^3], in the fullest reading, whose cone lies in the organ; at least one.

    Args:
        cone: What a reading sees.
        readings: What the sensing actions returned.
    """
    volume_m3 = math.pi / 3.0 * math.tan(cone.half_angle_rad) ** 2 * cone.depth_m**3
    return max((len(reading.points_m) for reading in readings), default=1) / volume_m3


def n_lesions(points_m: NDArray[np.float64], spacing_m: float) -> int:
    """The number of clusters of likely tumour; points within one and a half spacings belong to one (single linkage).

    Args:
        points_m: Places where tumour is likely [m], shape (P, 3).
        spacing_m: Distance between neighbouring points of one lesion, of the coarser of map and labels [m].
    """
    if not len(points_m):
        return 0
    _, first = np.unique(np.floor(points_m / (_THINNED * spacing_m)), axis=0, return_index=True)
    points_m = points_m[first]
    pairs = KDTree(points_m).query_pairs(_SPACINGS * spacing_m, output_type="ndarray")
    links = sparse.coo_matrix((np.ones(len(pairs), dtype=bool), pairs.T), shape=(len(points_m),) * 2)
    return int(connected_components(links, directed=False)[0])

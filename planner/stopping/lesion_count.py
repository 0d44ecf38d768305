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
_FAR_SPACINGS = 3.0
"""So do points within this many, where nothing free was seen between them."""
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
    return max([1, *(len(reading.points_m) for reading in readings)]) / volume_m3


def n_lesions(points_m: NDArray[np.float64], free_m: NDArray[np.float64], spacing_m: float) -> int:
    """The number of clusters of likely tumour, by single linkage.

    Points within one and a half spacings belong to one lesion. So do points within three, as long as no label of free
    tissue lies in the ball that has them as its poles (an edge of a Gabriel graph): few labels meet a small lesion.

    Args:
        points_m: Places where tumour is likely [m], shape (P, 3).
        free_m: Places that a reading called free [m], shape (F, 3).
        spacing_m: Distance between neighbouring points of one lesion, of the coarser of map and labels [m].
    """
    if not len(points_m):
        return 0
    _, first = np.unique(np.floor(points_m / (_THINNED * spacing_m)), axis=0, return_index=True)
    points_m = points_m[first]
    near = KDTree(points_m).query_pairs(_SPACINGS * spacing_m, output_type="ndarray")
    n, cluster = _linked(near, len(points_m))
    far = _nearest_of_others(points_m, cluster, _FAR_SPACINGS * spacing_m)
    if n == 1 or not len(far) or not len(free_m):
        return _linked(cluster[far], n)[0]
    ends_m = points_m[far]
    gap_m, _ = KDTree(free_m).query(ends_m.mean(axis=1))
    is_free_between = gap_m < np.linalg.norm(ends_m[:, 0] - ends_m[:, 1], axis=1) / 2.0
    return _linked(cluster[far[~is_free_between]], n)[0]


def _nearest_of_others(
    points_m: NDArray[np.float64], cluster: NDArray[np.intp], within_m: float
) -> NDArray[np.intp]:
    """Pairs of points of two clusters, each with the nearest of the other within a distance, shape (pairs, 2)."""
    pairs = [np.empty((0, 2), dtype=np.intp)]
    size = np.bincount(cluster)
    # One of any two clusters is not the largest.
    for each in np.argsort(size)[:-1]:
        own, others = np.flatnonzero(cluster == each), np.flatnonzero(cluster != each)
        gap_m, nearest = KDTree(points_m[own]).query(points_m[others], distance_upper_bound=within_m)
        is_near = np.isfinite(gap_m)
        pairs.append(np.column_stack([others[is_near], own[np.asarray(nearest)[is_near]]]))
    return np.concatenate(pairs)


def _linked(pairs: NDArray[np.intp], n: int) -> tuple[int, NDArray[np.intp]]:
    """The number of connected components of n things that are linked in pairs, and the component of each."""
    links = sparse.coo_matrix((np.ones(len(pairs), dtype=bool), pairs.T), shape=(n, n))
    number, component = connected_components(links, directed=False)
    return int(number), component.astype(np.intp)

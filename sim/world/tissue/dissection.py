"""An order of a lattice's nodes in which a sparse factorisation stays sparse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LEAF_NODES = 24
"""Parts of no more nodes are not divided."""


def nested_dissection(nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """The order of nested dissection (George, SIAM J. Numer. Anal. 10, 1973), shape (N,).

    The nodes are parted by a plane across their longest side; both parts come before the plane, each ordered likewise.

    Args:
        nodes: Places of the nodes on their lattice, shape (N, 3).
    """
    return np.concatenate(_parts(nodes, np.arange(len(nodes))))


def _parts(nodes: NDArray[np.int64], rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    places = nodes[rows]
    spans = np.ptp(places, axis=0) if len(rows) else np.zeros(3, dtype=np.int64)
    axis = int(spans.argmax())
    if len(rows) <= LEAF_NODES or spans[axis] < 2:
        return [rows]
    along = places[:, axis]
    plane = int(np.clip(np.median(along), along.min() + 1, along.max() - 1))
    below, above = rows[along < plane], rows[along > plane]
    return [*_parts(nodes, below), *_parts(nodes, above), rows[along == plane]]

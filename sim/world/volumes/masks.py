"""Masks of voxels: the connected pieces of one, the box that holds it, and its cavities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import generate_binary_structure, label


def count_pieces(mask: NDArray[np.bool_], pieces: NDArray[np.int32], *, is_by_corner: bool = False) -> int:
    """The number of connected pieces of a mask.

    Args:
        mask: The mask, shape (I, J, K).
        pieces: Where each voxel's piece is written, 0 for none, shape (I, J, K).
        is_by_corner: Whether voxels that touch by a corner are connected, and not only those that share a face.
    """
    label(mask, structure=generate_binary_structure(3, 3 if is_by_corner else 1), output=pieces)
    return int(pieces.max(initial=0))


def label_pieces(
    labels: NDArray[np.uint16], wanted: Sequence[tuple[int, ...]]
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """The connected pieces of labels, each label by itself; voxels that touch by a corner are connected.

    Args:
        labels: Number of each voxel, shape (I, J, K).
        wanted: The numbers of each label whose pieces are numbered.

    Returns:
        Piece of each voxel, 0 for none, and numbers of voxels, that of piece 1 at index 1.
    """
    pieces, n = np.zeros(labels.shape, dtype=np.int32), 0
    for each in wanted:
        found = np.empty(labels.shape, dtype=np.int32)
        n_found = count_pieces(np.isin(labels, each), found, is_by_corner=True)
        pieces[found > 0] = found[found > 0] + n
        n += n_found
    return pieces, np.bincount(pieces.ravel(), minlength=n + 1)


def box_of(mask: NDArray[np.bool_]) -> tuple[slice, slice, slice]:
    """The part of a grid that holds all of a mask, which holds at least one voxel."""
    ends = [np.flatnonzero(mask.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    i, j, k = (slice(int(end[0]), int(end[-1]) + 1) for end in ends)
    return i, j, k


def filled(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The mask with its cavities: all that is not connected with the outside."""
    outside = np.empty(np.array(mask.shape) + 2, dtype=np.int32)
    count_pieces(~np.pad(mask, 1), outside)
    return (outside != outside[0, 0, 0])[1:-1, 1:-1, 1:-1]

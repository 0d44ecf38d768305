"""Labels gathered layer by layer: of each part only the box that holds labels is kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import VolumeError

LARGEST_LABEL = 65_535

MOST_LABELS = 500
"""A file with more different values is an image; the finest atlas of the body has about 120 labels."""

TOO_MANY = (
    f"holds more than {MOST_LABELS} different values; this looks like the scan itself. Give the segmentation, whole "
    "numbers with one label per structure"
)

Bounds = NDArray[np.int64]
"""First and last index along each axis, shape (3, 2), the last excluded."""


class GatheredLabels:
    """What was read of a volume so far."""

    def __init__(self, path: Path) -> None:
        """Begin before the first layer of a file, whose name is for messages."""
        self._path, self._n_layers = path, 0
        self._kept: list[tuple[Bounds, NDArray[np.uint16]]] = []
        self._counts = np.zeros(LARGEST_LABEL + 1, dtype=np.int64)

    def add(self, values: NDArray[Any]) -> None:
        """Take the next layers in.

        Args:
            values: Whole numbers from 0 to 65,535 of any type, shape (I, J, n).

        Raises:
            VolumeError: There are more different values than any segmentation has.
        """
        seen = values != 0
        across = seen.any(axis=2)
        ends = [
            np.flatnonzero(each) for each in (across.any(axis=1), across.any(axis=0), seen.any(axis=(0, 1)))
        ]
        if len(ends[0]):
            bounds = np.array([(int(end[0]), int(end[-1]) + 1) for end in ends])
            labels = values[_slices(bounds)].astype(np.uint16)
            self._counts += np.bincount(labels.ravel(order="K"), minlength=len(self._counts))
            if np.count_nonzero(self._counts[1:]) > MOST_LABELS:
                raise VolumeError(f"{self._path}: {TOO_MANY}")
            bounds[2] += self._n_layers
            self._kept.append((bounds, labels))
        self._n_layers += values.shape[2]

    def together(self) -> tuple[NDArray[np.uint16], tuple[slice, slice, slice], dict[int, int]]:
        """The labels, the part of the volume that they are, and the number of voxels of each label but 0.

        Raises:
            VolumeError: There is nothing but background.
        """
        if not self._kept:
            raise VolumeError(f"{self._path}: holds no label, only background; export the segmentation again")
        every = np.array([bounds for bounds, _ in self._kept])
        low, high = every[:, :, 0].min(axis=0), every[:, :, 1].max(axis=0)
        whole = np.zeros(high - low, dtype=np.uint16, order="F")
        # A part that was put in its place is let go, so that memory holds no label twice for long.
        while self._kept:
            bounds, labels = self._kept.pop()
            whole[_slices(bounds - low[:, None])] = labels
        counts = {int(each): int(self._counts[each]) for each in np.flatnonzero(self._counts[1:]) + 1}
        return whole, _slices(np.stack([low, high], axis=1)), counts


def _slices(bounds: Bounds) -> tuple[slice, slice, slice]:
    i, j, k = (slice(int(first), int(last)) for first, last in bounds)
    return i, j, k

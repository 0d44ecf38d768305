"""Voxel values as labels: whole numbers from 0 to 65,535, whatever type the file keeps them in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import VolumeError

LARGEST_LABEL = 65_535

MOST_LABELS = 500
"""A file with more different values is an image; the finest atlas of the body has about 120 labels."""

ROUNDING = 1e-3
"""How far a number may be from a whole one and still be it: what resampling to nearest and scaling leave."""

SLAB_VOXELS = 4_000_000
"""Voxels looked at together: about 100 MB of temporaries."""


def as_labels(
    path: Path, values: NDArray[Any], *, slope: float, intercept: float
) -> tuple[NDArray[np.uint16], dict[int, int], list[str]]:
    """The labels of voxels, how many voxels each has, and remarks.

    Numbers from 0 to 1 that are not whole are taken for probabilities, and those above one half for label 1.

    Args:
        path: The file, for messages.
        values: What the file holds, shape (I, J, K).
        slope: Factor of the values.
        intercept: What is added after.

    Raises:
        VolumeError: The values are no labels, or there is nothing but background.
    """
    if not (np.isfinite(slope) and np.isfinite(intercept) and slope != 0.0):
        slope, intercept = 1.0, 0.0
    is_plain = values.dtype.kind in "iu" and slope == 1.0 and intercept == 0.0
    low, high, is_whole, n_nan = (*_range(values), True, 0) if is_plain else _survey(values, slope, intercept)
    remarks = [f"{n_nan:,} voxels are NaN or infinite and count as background"] if n_nan else []
    is_probability = not is_whole and low >= -ROUNDING and high <= 1.0 + ROUNDING
    if is_probability:
        remarks.append("the values lie between 0 and 1: those above 0.5 are taken for label 1")
    elif not is_whole or low < -ROUNDING or high > LARGEST_LABEL:
        raise VolumeError(
            f"{path}: its values go from {low:.6g} to {high:.6g}{'' if is_whole else ' and are not whole'}; this "
            "looks like the scan itself. Give the segmentation, whole numbers with one label per structure"
        )
    labels = np.empty(values.shape, dtype=np.uint16, order="F")
    counts = np.zeros(LARGEST_LABEL + 1, dtype=np.int64)
    for slab in _slabs(values.shape):
        scaled = values[slab] if is_plain else _scaled(values[slab], slope, intercept)
        labels[slab] = scaled > 0.5 if is_probability else np.rint(scaled)
        counts += np.bincount(labels[slab].ravel(order="K"), minlength=len(counts))
    present = np.flatnonzero(counts[1:]) + 1
    if not len(present):
        raise VolumeError(f"{path}: holds no label, only background; export the segmentation again")
    if len(present) > MOST_LABELS:
        raise VolumeError(
            f"{path}: holds {len(present):,} different values; this looks like the scan itself. Give the "
            "segmentation, whole numbers with one label per structure"
        )
    return labels, {int(label): int(counts[label]) for label in present}, remarks


def _range(values: NDArray[Any]) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _survey(values: NDArray[Any], slope: float, intercept: float) -> tuple[float, float, bool, int]:
    """Least and greatest finite value, whether all are whole, and how many are not finite."""
    low, high, is_whole, n_nan = np.inf, -np.inf, True, 0
    for slab in _slabs(values.shape):
        raw = values[slab]
        n_nan += int((~np.isfinite(raw)).sum())
        scaled = _scaled(raw, slope, intercept)
        low, high = min(low, float(scaled.min())), max(high, float(scaled.max()))
        is_whole = is_whole and bool((np.abs(scaled - np.rint(scaled)) <= ROUNDING).all())
    return low, high, is_whole, n_nan


def _scaled(values: NDArray[Any], slope: float, intercept: float) -> NDArray[np.float64]:
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = values.astype(np.float64) * slope + intercept
    return np.where(np.isfinite(values) & np.isfinite(scaled), scaled, 0.0)


def _slabs(shape: tuple[int, ...]) -> Iterator[tuple[slice, slice, slice]]:
    """Parts of a volume, along its last axis."""
    thickness = max(1, SLAB_VOXELS // max(shape[0] * shape[1], 1))
    for first in range(0, shape[2], thickness):
        yield slice(None), slice(None), slice(first, first + thickness)

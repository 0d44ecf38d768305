"""Voxel values as labels: whole numbers from 0 to 65,535, whatever type the file keeps them in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import VolumeError

from .gathered_labels import LARGEST_LABEL, GatheredLabels

ROUNDING = 1e-3
"""How far a number may be from a whole one and still be it: what resampling to nearest and scaling leave."""

SLAB_VOXELS = 4_000_000
"""Voxels looked at together: about 100 MB of temporaries."""

Layers = Callable[[int], Iterator[NDArray[Any]]]
"""Reads voxels in order, in parts of so many layers across the last axis, shape (I, J, n)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundLabels:
    """The part of a volume that holds labels.

    Attributes:
        labels: Label of each voxel of the part, 0 for none, Fortran order.
        box: Which part of the volume it is.
        counts: Number of voxels of each label that occurs, 0 left out.
        remarks: One sentence for each remarkable property.
    """

    labels: NDArray[np.uint16]
    box: tuple[slice, slice, slice]
    counts: dict[int, int]
    remarks: list[str]


def read_labels(
    path: Path,
    layers: Layers,
    shape: tuple[int, int, int],
    *,
    dtype: np.dtype[Any],
    slope: float,
    intercept: float,
) -> FoundLabels:
    """The labels of voxels, of which memory never holds more than some layers and what is labelled.

    Numbers from 0 to 1 that are not whole are taken for probabilities, and those above one half for label 1. Numbers
    that have to be scaled or may have a fraction are read twice.

    Args:
        path: The file, for messages.
        layers: Reads the voxels.
        shape: Numbers of voxels.
        dtype: Type of the voxels.
        slope: Factor of the values.
        intercept: What is added after.

    Raises:
        VolumeError: The values are no labels, or there is nothing but background.
    """
    if not (np.isfinite(slope) and np.isfinite(intercept) and slope != 0.0):
        slope, intercept = 1.0, 0.0
    thickness = max(1, SLAB_VOXELS // max(shape[0] * shape[1], 1))
    remarks: list[str] = []
    if dtype.kind in "iu" and slope == 1.0 and intercept == 0.0:
        gathered = _gather_plain(path, layers(thickness))
    else:
        low, high, is_whole, n_nan = _survey(layers(thickness), slope, intercept)
        if n_nan:
            voxels = "a voxel is" if n_nan == 1 else f"{n_nan:,} voxels are"
            remarks.append(f"{voxels} NaN or infinite, which counts as background")
        is_probability = not is_whole and low >= -ROUNDING and high <= 1.0 + ROUNDING
        if is_probability:
            remarks.append("the values lie between 0 and 1: those above 0.5 are taken for label 1")
        else:
            _check_range(path, low, high, is_whole=is_whole)
        gathered = GatheredLabels(path)
        for part in layers(thickness):
            scaled = _scaled(part, slope, intercept)
            gathered.add(scaled > 0.5 if is_probability else np.rint(scaled))
    labels, box, counts = gathered.together()
    return FoundLabels(labels=labels, box=box, counts=counts, remarks=remarks)


def _gather_plain(path: Path, parts: Iterator[NDArray[Any]]) -> GatheredLabels:
    """The labels of whole numbers that are meant as they are."""
    gathered = GatheredLabels(path)
    low = high = 0.0
    for part in parts:
        low, high = min(low, float(part.min())), max(high, float(part.max()))
        if low >= 0.0 and high <= LARGEST_LABEL:
            gathered.add(part)
    _check_range(path, low, high, is_whole=True)
    return gathered


def _check_range(path: Path, low: float, high: float, *, is_whole: bool) -> None:
    if not is_whole or low < -ROUNDING or high > LARGEST_LABEL:
        raise VolumeError(
            f"{path}: its values go from {low:.6g} to {high:.6g}{'' if is_whole else ' and are not whole'}; this "
            "looks like the scan itself. Give the segmentation, whole numbers with one label per structure"
        )


def _survey(parts: Iterator[NDArray[Any]], slope: float, intercept: float) -> tuple[float, float, bool, int]:
    """Least and greatest finite value, whether all are whole, and how many are not finite."""
    low, high, is_whole, n_nan = np.inf, -np.inf, True, 0
    for raw in parts:
        n_nan += int((~np.isfinite(raw)).sum())
        scaled = _scaled(raw, slope, intercept)
        low, high = min(low, float(scaled.min())), max(high, float(scaled.max()))
        is_whole = is_whole and bool((np.abs(scaled - np.rint(scaled)) <= ROUNDING).all())
    return low, high, is_whole, n_nan


def _scaled(values: NDArray[Any], slope: float, intercept: float) -> NDArray[np.float64]:
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = values.astype(np.float64) * slope + intercept
    return np.where(np.isfinite(values) & np.isfinite(scaled), scaled, 0.0)

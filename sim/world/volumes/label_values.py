"""Voxel values as labels: whole numbers from 0 to 65,535, whatever type the file keeps them in."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.world.errors import VolumeError

from .gathered_labels import LARGEST_LABEL, MOST_LABELS, TOO_MANY, GatheredLabels

ROUNDING = 1e-3
"""How far a number may be from a whole one and still be it: what resampling to nearest and scaling leave."""

NEARLY_WHOLE = 0.05
"""How far a few different numbers may be off whole ones and still be labels that a program scaled and saved again."""

MOST_ROUNDING = 0.45
"""However wide the steps of a slope are, a number farther from a whole one is none."""

MOST_STORED = 4 * MOST_LABELS
"""More different numbers are an image, and need not all be looked at."""

FEW_STORED = 8
"""Numbers from 0 on without a gap are probabilities only if there are more of them."""

MOST_LEFT_OVER = 130
"""More different stored numbers are rather a scan of few grey values than labels with a scan's slope."""

PROBABILITY = "the values lie between 0 and 1: those above 0.5 are taken for label 1"

SLAB_VOXELS = 4_000_000
"""Voxels looked at together: about 100 MB of temporaries."""

Layers = Callable[[int], Iterator[NDArray[Any]]]
"""Reads voxels in order, in parts of so many layers across the last axis, shape (I, J, n)."""


ToLabels = Callable[[NDArray[Any]], NDArray[Any]]
"""Turns stored numbers into labels of the same shape."""


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
        if dtype.kind in "iu":
            to_labels, remarks = _of_scaled(path, layers(thickness), slope, intercept)
        else:
            to_labels, remarks = _of_fractions(path, lambda: layers(thickness), slope, intercept)
        gathered = GatheredLabels(path)
        for part in layers(thickness):
            gathered.add(to_labels(part))
    labels, box, counts = gathered.together()
    return FoundLabels(labels=labels, box=box, counts=counts, remarks=remarks)


def _of_scaled(
    path: Path, parts: Iterator[NDArray[Any]], slope: float, intercept: float
) -> tuple[ToLabels, list[str]]:
    """How whole numbers with a slope become labels, and remarks.

    A program that saves labels as fractions of a range rounds each to the next step, which is half a slope off at most.
    So numbers are labels if each lies that close to a whole one, and no two to the same one. Where they are none, and
    the stored numbers are, slope and intercept are left over from the scan whose header the file has.

    Raises:
        VolumeError: They are no labels.
    """
    stored = _stored_numbers(path, parts)
    values = stored * slope + intercept
    tolerance = min(ROUNDING + 0.5 * abs(slope), MOST_ROUNDING) if abs(slope) < 1.0 else ROUNDING
    whole = np.rint(values)
    is_close = bool((np.abs(values - whole) <= tolerance).all()) and len(np.unique(whole)) == len(stored)
    if is_close and whole.min() >= 0.0 and whole.max() <= LARGEST_LABEL and len(stored) <= MOST_LABELS + 1:
        return lambda part: np.rint(_scaled(part, slope, intercept)), []
    is_soft = values.min() >= -ROUNDING and values.max() <= 1.0 + ROUNDING
    if is_soft and (len(stored) > FEW_STORED or stored.max() >= len(stored)):
        return lambda part: _scaled(part, slope, intercept) > 0.5, [PROBABILITY]
    if stored.min() >= 0 and stored.max() <= LARGEST_LABEL and len(stored) <= MOST_LEFT_OVER:
        said = (
            f"its header has a slope of {slope:.6g} and an intercept of {intercept:.6g}, by which its values are no "
            f"labels; they are taken for left over from the scan, and the stored numbers, {stored.min()} to "
            f"{stored.max()}, for the labels"
        )
        return lambda part: part, [said]
    _check_range(path, float(values.min()), float(values.max()), is_whole=bool((values == whole).all()))
    raise VolumeError(f"{path}: {TOO_MANY}")


def _stored_numbers(path: Path, parts: Iterator[NDArray[Any]]) -> NDArray[np.int64]:
    """The different whole numbers that voxels are stored as, in order.

    Raises:
        VolumeError: There are more than any segmentation has.
    """
    stored = np.zeros(0, dtype=np.int64)
    for part in parts:
        if part.dtype.itemsize <= 2:
            # Marking numbers in a table is many times faster than sorting them.
            least, is_there = int(np.iinfo(part.dtype).min), np.zeros(1 << 16, dtype=bool)
            is_there[part.astype(np.int64) - least] = True
            found = np.flatnonzero(is_there) + least
        else:
            found = np.unique(part).astype(np.int64)
        stored = np.union1d(stored, found)
        if len(stored) > MOST_STORED:
            raise VolumeError(f"{path}: {TOO_MANY}")
    return stored


def _of_fractions(
    path: Path, parts: Callable[[], Iterator[NDArray[Any]]], slope: float, intercept: float
) -> tuple[ToLabels, list[str]]:
    """How floating-point numbers become labels, and remarks.

    Raises:
        VolumeError: They are no labels.
    """
    low, high, is_whole, n_nan = _survey(parts(), slope, intercept)
    remarks = []
    if n_nan:
        voxels = "a voxel is" if n_nan == 1 else f"{n_nan:,} voxels are"
        remarks.append(f"{voxels} NaN or infinite, which counts as background")
    if not is_whole and low >= -ROUNDING and high <= 1.0 + ROUNDING:
        return lambda part: _scaled(part, slope, intercept) > 0.5, [*remarks, PROBABILITY]
    if not is_whole and low >= -NEARLY_WHOLE:
        off = _farthest_of_few(_scaled(part, slope, intercept) for part in parts())
        if is_whole := off <= NEARLY_WHOLE:
            low = float(np.rint(low))
            remarks.append(f"its values are up to {off:.2g} off whole numbers, to which they were rounded")
    _check_range(path, low, high, is_whole=is_whole)
    return lambda part: np.rint(_scaled(part, slope, intercept)), remarks


def _farthest_of_few(parts: Iterator[NDArray[np.float64]]) -> float:
    """How far values are from whole numbers; infinite if there are many, or several by one whole number."""
    values = np.zeros(0)
    for part in parts:
        values = np.union1d(values, part)
        if len(values) > MOST_LABELS:
            return np.inf
    whole = np.rint(values)
    return float(np.abs(values - whole).max()) if len(np.unique(whole)) == len(values) else np.inf


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

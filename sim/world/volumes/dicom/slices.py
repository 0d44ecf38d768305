"""Where DICOM's slices lie: a stack of them as one grid in patient axes, whatever order they come in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MM = 1e-3
"""DICOM's lengths are millimetres, its axes LPS."""
EVEN, ROUNDED_MM = 0.02, 0.015
"""Share of the spacing by which a slice may lie off its place, and what rounding to hundredths of a millimetre adds."""
MOST_OFF = 0.1
"""Share of the spacing by which no slice lies off its place, however fine and however rounded it is."""
SAME_MM = 1e-3
"""Slices nearer to each other than this lie at one place."""
PARALLEL = 1e-4
"""Slices whose directions differ by more are no stack."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Stack:
    """A stack of slices."""

    T_lps_voxel: NDArray[np.float64]
    """Maps indices (column, row, slice) to patient axes [m], shape (4, 4)."""
    indices: NDArray[np.intp]
    """The index along the stack of each slice that was given, shape (N,)."""

    @property
    def n_slices(self) -> int:
        """Slices from the first to the last, those in between that are missing too."""
        return int(self.indices.max()) + 1


def stack_of(
    positions_mm: ArrayLike,
    orientations: Sequence[Sequence[float]],
    pixel_spacing_mm: Sequence[float],
    slice_spacing_mm: float | None = None,
    thickness_mm: float | None = None,
) -> Stack:
    """The stack of some slices.

    Args:
        positions_mm: Image Position (Patient) of each slice, the middle of its first pixel, LPS [mm], shape (N, 3).
        orientations: Image Orientation (Patient) of each: the directions along a row and along a column, six numbers.
        pixel_spacing_mm: Pixel Spacing: between rows, and between columns [mm].
        slice_spacing_mm: Spacing Between Slices [mm], which tells of slices that are missing; None, or one at which the
            slices do not lie, for the least step that there is.
        thickness_mm: Slice Thickness [mm], which stands for the spacing of one slice alone; slices may overlap, or lie
            farther apart than they are thick.

    Raises:
        ValueError: The slices are not parallel, or not evenly spaced.
    """
    directions = np.asarray(orientations, dtype=np.float64).reshape(-1, 2, 3)
    along_row, along_column = directions[0]
    if np.abs(directions - directions[0]).max() > PARALLEL or abs(along_row @ along_column) > PARALLEL:
        raise ValueError("its slices are not parallel, or their axes not at right angles")
    normal, places = np.cross(along_row, along_column), np.asarray(positions_mm, dtype=np.float64)
    heights = places @ normal
    indices, spacing = _counted(heights, abs(slice_spacing_mm or 0.0), abs(thickness_mm or 0.0))
    lowest = int(np.argmin(heights))
    above = heights - heights[lowest]
    aside = places - places[lowest] - above[:, None] * normal
    most_mm = _tolerance_mm(spacing)
    if np.abs(above - spacing * indices).max() > most_mm or np.abs(aside).max() > most_mm:
        raise ValueError("its slices are not evenly spaced")
    T = np.eye(4)
    between_rows, between_columns = pixel_spacing_mm
    T[:3, :3] = np.column_stack([along_row * between_columns, along_column * between_rows, normal * spacing])
    T[:3, 3] = places[lowest]
    T[:3] *= MM
    return Stack(T_lps_voxel=T, indices=indices)


def _counted(
    heights_mm: NDArray[np.float64], told_mm: float, thickness_mm: float
) -> tuple[NDArray[np.intp], float]:
    """The index of each slice along the stack by its height, and the spacing [mm]; 0 stands for nothing told.

    Raises:
        ValueError: There is one slice alone, and no thickness.
    """
    order = np.argsort(heights_mm, kind="stable")
    steps = np.diff(heights_mm[order])
    apart = steps[steps > SAME_MM]
    least = float(apart.min()) if len(apart) else thickness_mm
    # What is told counts where slices may be missing. Where they do not lie at it, it is a gap or a thickness.
    if told_mm and (not len(apart) or _are_multiples(apart, told_mm)):
        least = told_mm
    if not least > 0.0:
        raise ValueError("it has one slice alone, and says nothing of its thickness")
    # Counted from slice to slice, so that what the first step is rounded by does not add up over the stack.
    counted = np.where(steps > SAME_MM, np.rint(steps / least), 0.0)
    indices = np.empty(len(heights_mm), dtype=np.intp)
    indices[order] = np.concatenate([[0.0], np.cumsum(counted)])
    n_steps = int(indices.max())
    return indices, float(np.ptp(heights_mm)) / n_steps if n_steps else least


def _are_multiples(steps_mm: NDArray[np.float64], spacing_mm: float) -> bool:
    """Whether steps are as long as one or more spacings."""
    n = np.rint(steps_mm / spacing_mm)
    return bool((n >= 1.0).all() and (np.abs(steps_mm - n * spacing_mm) <= _tolerance_mm(spacing_mm)).all())


def _tolerance_mm(spacing_mm: float) -> float:
    """How far a slice may lie off its place [mm]."""
    return min(EVEN * spacing_mm + ROUNDED_MM, MOST_OFF * spacing_mm)


def stack_of_files(slices: Sequence[Any]) -> Stack:
    """The stack of the single-frame datasets of a series.

    Args:
        slices: The datasets, in any order.

    Raises:
        ValueError: They are no stack.
    """
    return stack_of(
        [each.ImagePositionPatient for each in slices],
        [each.ImageOrientationPatient for each in slices],
        slices[0].PixelSpacing,
    )

"""Where DICOM's slices lie: a stack of them as one grid in patient axes, whatever order they come in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MM = 1e-3
"""DICOM's lengths are millimetres, its axes LPS."""
EVEN = 0.02
"""Share of the spacing by which a slice may lie off its place."""
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
) -> Stack:
    """The stack of some slices.

    Args:
        positions_mm: Image Position (Patient) of each slice, the middle of its first pixel, LPS [mm], shape (N, 3).
        orientations: Image Orientation (Patient) of each: the directions along a row and along a column, six numbers.
        pixel_spacing_mm: Pixel Spacing: between rows, and between columns [mm].
        slice_spacing_mm: Between slices [mm], where slices may be missing; None for the least step that there is.

    Raises:
        ValueError: The slices are not parallel, or not evenly spaced.
    """
    directions = np.asarray(orientations, dtype=np.float64).reshape(-1, 2, 3)
    along_row, along_column = directions[0]
    if np.abs(directions - directions[0]).max() > PARALLEL or abs(along_row @ along_column) > PARALLEL:
        raise ValueError("its slices are not parallel, or their axes not at right angles")
    normal, places = np.cross(along_row, along_column), np.asarray(positions_mm, dtype=np.float64)
    heights = places @ normal
    steps = np.diff(np.unique(np.round(heights, 4)))
    spacing = slice_spacing_mm or (float(steps.min()) if len(steps) else 0.0)
    if not spacing > 0.0:
        raise ValueError("it has one slice alone, and says nothing of its thickness")
    lowest = int(np.argmin(heights))
    numbers = (heights - heights[lowest]) / spacing
    indices = np.rint(numbers).astype(np.intp)
    aside = places - places[lowest] - numbers[:, None] * spacing * normal
    if np.abs(numbers - indices).max() > EVEN or np.abs(aside).max() > EVEN * spacing:
        raise ValueError("its slices are not evenly spaced")
    T = np.eye(4)
    between_rows, between_columns = pixel_spacing_mm
    T[:3, :3] = np.column_stack([along_row * between_columns, along_column * between_rows, normal * spacing])
    T[:3, 3] = places[lowest]
    T[:3] *= MM
    return Stack(T_lps_voxel=T, indices=indices)


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

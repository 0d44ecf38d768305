"""The frames that the network reads: pictures of a sweep on the grid of the array's own lines.

A frame has rows of depth below the face and columns of angle, cells of about 1 mm by half a degree. Each holds the mean
brightness of the picture's pixels there, which evens out some of the speckle. Beside its own plane a frame has those
before and after it, since speckle changes from plane to plane and a lesion goes on; and three channels that say how
deep each row lies, how wide its cells are and how far away the neighbouring planes are there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.sensing.sweep import Sweep

from ..ultrasound.convex_array import ConvexArray

N_COLUMNS = 96
"""Columns of a frame."""
ROW_M = 0.001
"""About how deep a row is [m]."""
MULTIPLE = 16
"""Rows are a multiple of this, since the network halves them four times."""
SUBSAMPLES = (3, 4)
"""Places along the depth and across the lines at which a cell's brightness is looked up."""
N_CHANNELS = 6
MIDDLE, UNIT = 96.0, 64.0
"""Brightness that becomes 0, and how much of it becomes 1."""


@dataclass(frozen=True, eq=False)
class FrameGrid:
    """Where the cells of frames lie in the pictures of one array."""

    array: ConvexArray
    n_rows: int

    @classmethod
    def of(cls, array: ConvexArray) -> FrameGrid:
        """The grid of an array, whose rows are about 1 mm deep."""
        return cls(array, MULTIPLE * max(round(array.depth_m / (MULTIPLE * ROW_M)), 1))

    @property
    def row_m(self) -> float:
        """Depth of a row [m]."""
        return self.array.depth_m / self.n_rows

    @property
    def column_rad(self) -> float:
        """Angle of a column [rad]."""
        return 2.0 * self.array.half_angle_rad / N_COLUMNS

    def points_m(self, rows: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where places of a frame lie in the plane, x and z [m], shape (..., 2).

        Args:
            rows: Numbers of rows, 0 in the middle of the first, any shape.
            columns: Numbers of columns, in the same shape.
        """
        range_m = self.array.radius_m + (rows + 0.5) * self.row_m
        angle_rad = (columns + 0.5) * self.column_rad - self.array.half_angle_rad
        return np.stack(
            [range_m * np.sin(angle_rad), range_m * np.cos(angle_rad) - self.array.radius_m], axis=-1
        )

    def places(self, in_plane_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows and columns of points of a plane, not rounded, shape (N, 2): the inverse of `points_m`.

        Args:
            in_plane_m: x and z in the plane [m], shape (N, 2).
        """
        x_m, z_m = in_plane_m[:, 0], in_plane_m[:, 1] + self.array.radius_m
        rows = (np.hypot(x_m, z_m) - self.array.radius_m) / self.row_m - 0.5
        columns = (np.arctan2(x_m, z_m) + self.array.half_angle_rad) / self.column_rad - 0.5
        return np.stack([rows, columns], axis=-1)

    def brightness(self, sweep: Sweep) -> NDArray[np.float32]:
        """Mean brightness of the cells of each plane, 0 to 255, shape (P, n_rows, N_COLUMNS).

        Args:
            sweep: Pictures of planes.
        """
        down, across = ((np.arange(n) + 0.5) / n - 0.5 for n in SUBSAMPLES)
        rows = (np.arange(self.n_rows)[:, None] + down).ravel()
        columns = (np.arange(N_COLUMNS)[:, None] + across).ravel()
        x_z_m = self.points_m(*np.meshgrid(rows, columns, indexing="ij"))
        n_down, n_right = sweep.images.shape[1:]
        right = ((x_z_m[..., 0] - sweep.left_m) / sweep.pixel_m).astype(np.int64)
        pixels = ((x_z_m[..., 1] - sweep.top_m) / sweep.pixel_m).astype(np.int64)
        pixels = np.clip(pixels, 0, n_down - 1) * n_right + np.clip(right, 0, n_right - 1)
        pixels = pixels.reshape(self.n_rows, SUBSAMPLES[0], N_COLUMNS, SUBSAMPLES[1])
        pixels = np.ascontiguousarray(pixels.transpose(1, 3, 0, 2)).reshape(-1, self.n_rows * N_COLUMNS)
        flat = sweep.images.reshape(len(sweep.images), -1)
        sums = np.zeros((len(flat), self.n_rows * N_COLUMNS), np.uint16)
        for each in pixels:
            sums += flat[:, each]
        mean = sums.astype(np.float32) / np.float32(len(pixels))
        return mean.reshape(len(flat), self.n_rows, N_COLUMNS)


def frames_of(grid: FrameGrid, brightness: NDArray[np.float32], plane_rad: float) -> NDArray[np.float32]:
    """What the network reads of each plane, shape (P, N_CHANNELS, n_rows, N_COLUMNS).

    The first and the last plane stand for the neighbour that they lack.

    Args:
        grid: Where the cells lie.
        brightness: Mean brightness of the cells, shape (P, n_rows, N_COLUMNS).
        plane_rad: Angle from plane to plane [rad].
    """
    n_planes = len(brightness)
    frames = np.empty((n_planes, N_CHANNELS, grid.n_rows, N_COLUMNS), np.float32)
    level = (brightness - np.float32(MIDDLE)) / np.float32(UNIT)
    for channel, shift in enumerate((-1, 0, 1)):
        frames[:, channel] = level[np.clip(np.arange(n_planes) + shift, 0, n_planes - 1)]
    frames[:, 3:] = _geometry(grid, plane_rad)[None]
    return frames


def _geometry(grid: FrameGrid, plane_rad: float) -> NDArray[np.float32]:
    """Depth of each row, width of its cells, and the gap between planes there, shape (3, n_rows, N_COLUMNS)."""
    depth_m = (np.arange(grid.n_rows) + 0.5) * grid.row_m
    width_m = (grid.array.radius_m + depth_m) * grid.column_rad
    channels = np.stack([depth_m / 0.065 - 1.0, width_m / 0.001 - 1.0, depth_m * plane_rad / 0.0025 - 1.0])
    return np.repeat(channels[:, :, None], N_COLUMNS, axis=2).astype(np.float32)


def plane_angle_rad(sweep: Sweep) -> float:
    """Angle from plane to plane of a sweep [rad], 0 of a single plane."""
    if len(sweep.T_world_planes) < 2:
        return 0.0
    first, second = sweep.T_world_planes[:2, :3, 2]
    return math.acos(float(np.clip(first @ second, -1.0, 1.0)))

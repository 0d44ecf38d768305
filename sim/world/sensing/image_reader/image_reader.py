"""The reader: where in the pictures of a sweep there are lesions, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from sim.world.sensing.sweep import Sweep

from ..ultrasound.convex_array import ConvexArray
from .frames import FrameGrid, frames_of, plane_angle_rad
from .network import logits_of
from .weights import ReaderWeights, load_weights


@dataclass(frozen=True, eq=False)
class ReadPlanes:
    """What the reader makes of the planes of a sweep."""

    grid: FrameGrid
    log_odds: NDArray[np.float32]
    """Log odds that each cell is lesion, calibrated, shape (P, rows, columns)."""

    def at(self, sweep: Sweep, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The log odds at the points of a reading, between cells interpolated, shape (N,).

        Args:
            sweep: Whose planes they lie on.
            points_m: The points, world frame [m], shape (N, 3).
        """
        T = sweep.T_world_planes[sweep.planes]
        in_plane_m = np.einsum("nji,nj->ni", T[:, :3, :3], points_m - T[:, :3, 3])
        rows, columns = self.grid.places(in_plane_m[:, [0, 2]]).T
        return map_coordinates(
            self.log_odds.astype(np.float64), [sweep.planes, rows, columns], order=1, mode="nearest"
        )

    def picture(self, sweep: Sweep, plane: int) -> NDArray[np.bool_]:
        """Which pixels of a plane's picture are lesion, shape (rows, columns) of the picture.

        Args:
            sweep: The pictures.
            plane: Number of the plane.
        """
        n_rows, n_columns = sweep.images.shape[1:]
        x_m = sweep.left_m + (np.arange(n_columns) + 0.5) * sweep.pixel_m
        z_m = sweep.top_m + (np.arange(n_rows) + 0.5) * sweep.pixel_m
        x_z_m = np.stack(np.meshgrid(x_m, z_m), axis=-1).reshape(-1, 2)
        rows, columns = self.grid.places(x_z_m).T
        at = [rows, columns]
        values = map_coordinates(self.log_odds[plane].astype(np.float64), at, order=1, mode="nearest")
        is_in = (rows >= -0.5) & (rows <= self.grid.n_rows - 0.5)
        is_in &= (columns >= -0.5) & (columns <= self.log_odds.shape[2] - 0.5)
        return ((values > 0.0) & is_in).reshape(n_rows, n_columns)


@dataclass(frozen=True, kw_only=True)
class ImageReader:
    """Segments the planes of sweeps by a trained network. It keeps nothing: the same pictures give the same answer."""

    weights: ReaderWeights = field(default_factory=load_weights)
    """The trained network; by default the shipped one."""

    def read(self, sweep: Sweep, array: ConvexArray) -> ReadPlanes:
        """What lies in the planes of a sweep.

        Args:
            sweep: The pictures.
            array: What drew them.
        """
        grid = _grid(array)
        frames = frames_of(grid, grid.brightness(sweep), plane_angle_rad(sweep))
        answers = logits_of(self.weights, frames)
        return ReadPlanes(grid, np.float32(self.weights.scale) * answers + np.float32(self.weights.offset))


@lru_cache(maxsize=4)
def _grid(array: ConvexArray) -> FrameGrid:
    """The grid of an array, kept for the next sweep."""
    return FrameGrid.of(array)

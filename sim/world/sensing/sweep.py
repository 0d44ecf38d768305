"""A sweep: the pictures of planes that a probe draws about one contact."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

KeptPlanes = Literal["middle", "all", "none"]
"""Which pictures of a sweep are kept."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """Pictures of planes, and where the planes lie. A plane has x across the picture, z down it, and y through it."""

    images: NDArray[np.uint8]
    """Brightness, the probe's face on top, shape (P, rows, columns)."""
    T_world_planes: NDArray[np.float64]
    """Maps the coordinates of each plane, whose origin is the probe's tip, to the world, shape (P, 4, 4)."""
    pixel_m: float
    """Edge of a pixel [m]."""
    left_m: float
    """The x of the left edge of the pictures [m]."""
    top_m: float
    """The z of their upper edge [m]."""
    planes: NDArray[np.int64]
    """The plane that each point of the reading lies on, shape (N,)."""
    middle_lesions: NDArray[np.bool_] | None = None
    """Which pixels of the middle plane's picture a reader took for lesion, shape (rows, columns); None where nobody
    read the pictures."""

    @property
    def middle(self) -> int:
        """The plane nearest to the middle of the sweep."""
        return len(self.images) // 2

    def part(self, is_kept: NDArray[np.bool_]) -> Sweep:
        """The sweep beside a reading without some of its points.

        Args:
            is_kept: Which points stay, shape (N,).
        """
        return replace(self, planes=self.planes[is_kept])

    def pixels(self, points_m: NDArray[np.float64], plane: int) -> NDArray[np.float64]:
        """Rows and columns of points in the picture of a plane, not rounded, shape (N, 2).

        The middle of the first pixel is at row 0 and column 0.

        Args:
            points_m: Points on the plane, world frame [m], shape (N, 3).
            plane: Number of the plane.
        """
        T = self.T_world_planes[plane]
        in_plane_m = (points_m - T[:3, 3]) @ T[:3, :3]
        edges_m = np.array([self.top_m, self.left_m])
        return (in_plane_m[:, [2, 0]] - edges_m) / self.pixel_m - 0.5

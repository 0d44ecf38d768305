"""The frames of the two sides: the house's world in metres, and the patient's RAS in millimetres that Slicer speaks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.world.frames import rigid_inverse

R_RAS_LPS = np.diag([-1.0, -1.0, 1.0])
"""Right, anterior, superior from left, posterior, superior: half a turn about z."""
MM = 1e-3
"""Metres in a millimetre."""


@dataclass(frozen=True, eq=False)
class PatientFrame:
    """Where the patient lies in the world."""

    T_world_organ: NDArray[np.float64]
    """Maps patient axes (LPS) [m] to the world [m], shape (4, 4)."""

    @cached_property
    def T_ras_world(self) -> NDArray[np.float64]:
        """The rigid part of the way from the world to RAS, lengths still in metres, shape (4, 4)."""
        T_ras_lps = np.eye(4)
        T_ras_lps[:3, :3] = R_RAS_LPS
        return T_ras_lps @ rigid_inverse(self.T_world_organ)

    @cached_property
    def T_world_ras(self) -> NDArray[np.float64]:
        """The rigid part of the way from RAS to the world, lengths in metres, shape (4, 4)."""
        return rigid_inverse(self.T_ras_world)

    def pose_ras_mm(self, T_world: ArrayLike) -> NDArray[np.float64]:
        """A pose in the world [m] as one in RAS [mm], shape (4, 4); its axes keep their lengths."""
        T_ras = self.T_ras_world @ np.asarray(T_world, dtype=np.float64)
        T_ras[:3, 3] /= MM
        return T_ras

    def pose_world_m(self, T_ras_mm: ArrayLike) -> NDArray[np.float64]:
        """A pose in RAS [mm] as one in the world [m], shape (4, 4); its axes keep their lengths."""
        T_ras = np.array(T_ras_mm, dtype=np.float64)
        T_ras[:3, 3] *= MM
        return self.T_world_ras @ T_ras

    def grid_ras_mm(self, T_world_index: ArrayLike) -> NDArray[np.float64]:
        """The map from a grid's indices to the world [m] as one to RAS [mm], shape (4, 4)."""
        return np.diag([1.0 / MM, 1.0 / MM, 1.0 / MM, 1.0]) @ self.T_ras_world @ np.asarray(T_world_index)

    def grid_world_m(self, T_ras_index: ArrayLike) -> NDArray[np.float64]:
        """The map from a grid's indices to RAS [mm] as one to the world [m], shape (4, 4)."""
        return self.T_world_ras @ np.diag([MM, MM, MM, 1.0]) @ np.asarray(T_ras_index, dtype=np.float64)

    def points_ras_mm(self, points_m: ArrayLike) -> NDArray[np.float64]:
        """Points in the world [m], shape (N, 3), in RAS [mm]."""
        return (np.asarray(points_m) @ self.T_ras_world[:3, :3].T + self.T_ras_world[:3, 3]) / MM

    def points_world_m(self, points_ras_mm: ArrayLike) -> NDArray[np.float64]:
        """Points in RAS [mm], shape (N, 3), in the world [m]."""
        points_m = np.asarray(points_ras_mm, dtype=np.float64) * MM
        return points_m @ self.T_world_ras[:3, :3].T + self.T_world_ras[:3, 3]

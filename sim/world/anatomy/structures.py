"""Vessels, gallbladder and other structures about or in an organ: shown, kept away from, and measured to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.world.solids.solid import Solid
from sim.world.solids.surface_distance import surface_distance_of


@dataclass(frozen=True, eq=False, kw_only=True)
class Structure:
    """A structure beside organ and tumours. Its surface need not be closed: segmented vessels often end open.

    Attributes:
        name: What to call it.
        solid: Its surface [m].
        is_keepout: Whether the probe must not press near it.
    """

    name: str
    solid: Solid
    is_keepout: bool = False

    def transformed(self, T_target_structure: ArrayLike) -> Structure:
        """The structure moved by a rigid motion, 4 x 4."""
        return replace(self, solid=self.solid.transformed(T_target_structure))

    def distance_m(self, points_m: ArrayLike) -> NDArray[np.float64]:
        """Distance of points to the structure [m], 0 inside it.

        Args:
            points_m: Query points [m], shape (N, 3).

        Returns:
            Shape (N,), within 0.1 mm.
        """
        points = np.asarray(points_m, dtype=np.float64)
        distance_m = surface_distance_of(self.solid).distance_m(points)
        return np.where(self.solid.contains(points), 0.0, distance_m)


def is_pressable(
    positions_m: NDArray[np.float64], structures: tuple[Structure, ...], distance_m: float
) -> NDArray[np.bool_]:
    """Whether each surface position is clear of all structures to keep away from.

    Args:
        positions_m: Positions [m], shape (N, 3).
        structures: All structures, in the same frame.
        distance_m: Positions within this distance of one [m] are not clear.

    Returns:
        Shape (N,).
    """
    is_clear = np.ones(len(positions_m), dtype=bool)
    for structure in structures:
        if structure.is_keepout:
            is_clear &= structure.distance_m(positions_m) > distance_m
    return is_clear

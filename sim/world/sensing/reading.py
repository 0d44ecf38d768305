"""The reading: what one sensing action returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .sweep import Sweep


@dataclass(frozen=True, eq=False)
class Reading:
    """What one sensing action returns, the paper's D_t: points that were seen, each with its label."""

    points_m: NDArray[np.float64]
    """Points inside the organ that the sensor saw, world frame [m], shape (N, 3)."""
    is_occupied: NDArray[np.bool_]
    """Whether the sensor takes each point for tumour, shape (N,)."""
    T_world_probe: NDArray[np.float64]
    """Pose of the probe's tip at which the sensor looked, shape (4, 4)."""
    is_target: NDArray[np.bool_] | None = None
    """Whether the sensor takes each point for a body of the second class, shape (N,); None without such a class."""
    images: Sweep | None = None
    """The pictures that the reading was made of; None of a sensor that draws none."""

    def __post_init__(self) -> None:
        """Checks shapes and types, so that a sensor's slip shows here and not inside the map.

        Raises:
            ValueError: An array has another shape, or labels are not booleans.
        """
        n_points = len(self.points_m)
        shapes = {"points_m": (n_points, 3), "is_occupied": (n_points,), "T_world_probe": (4, 4)}
        labels = {"is_occupied": self.is_occupied}
        if self.is_target is not None:
            shapes["is_target"], labels["is_target"] = (n_points,), self.is_target
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(
                    f"{name} of a reading has shape {np.shape(getattr(self, name))}, expected {shape}."
                )
        for name, values in labels.items():
            if values.dtype != np.bool_:
                raise ValueError(f"{name} of a reading holds values of type {values.dtype}, expected bool.")

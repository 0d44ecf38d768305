"""The reading: what one sensing action returns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .sweep import Sweep

_Values = NDArray[np.float64] | None


@dataclass(frozen=True, eq=False)
class Reading:
    """What one sensing action returns, the paper's D_t: points that were seen, each with its label."""

    points_m: NDArray[np.float64]
    """Points inside the organ that the sensor saw, world frame [m], shape (N, 3)."""
    is_occupied: NDArray[np.bool_]
    """Whether the sensor takes each point for tumour, shape (N,)."""
    T_world_probe: NDArray[np.float64]
    """Pose of the probe's tip at which the sensor looked, as it is believed to be, shape (4, 4)."""
    is_target: NDArray[np.bool_] | None = None
    """Whether the sensor takes each point for a body of the second class, shape (N,); None without such a class."""
    images: Sweep | None = None
    """The pictures that the reading was made of; None of a sensor that draws none."""

    log_odds: NDArray[np.float64] | None = None
    """How far each label can be believed, log P(label | tumour) / P(label | free), shape (N,): above 0 where it speaks
    for tumour, infinite where it cannot be wrong. None where the sensor does not say."""
    weight: NDArray[np.float64] | None = None
    """How many labels, that err by themselves, each counts for, shape (N,), above 0 and at most 1: points that err
    together count for less. None where each counts in full."""

    def part(self, is_kept: NDArray[np.bool_]) -> Reading:
        """The reading without some of its points.

        Args:
            is_kept: Which points stay, shape (N,).
        """
        per_point = ("points_m", "is_occupied", "is_target", "log_odds", "weight")
        arrays = {name: getattr(self, name) for name in per_point if getattr(self, name) is not None}
        images = None if self.images is None else self.images.part(is_kept)
        return replace(self, images=images, **{name: array[is_kept] for name, array in arrays.items()})

    def moved(self, T: NDArray[np.float64]) -> Reading:
        """The reading as if everything, points, pictures and probe, lay elsewhere.

        Args:
            T: Maps where things lie to where they shall lie, shape (4, 4).
        """
        points_m = self.points_m @ T[:3, :3].T + T[:3, 3]
        images = None
        if self.images is not None:
            images = replace(self.images, T_world_planes=T @ self.images.T_world_planes)
        return replace(self, points_m=points_m, T_world_probe=T @ self.T_world_probe, images=images)

    @property
    def labels(self) -> tuple[NDArray[np.float64], NDArray[np.bool_], _Values, _Values]:
        """Points, labels, and what is said of each label: what maps and planners are shown, who cannot write to it."""
        return (
            _locked(self.points_m),
            _locked(self.is_occupied),
            None if self.log_odds is None else _locked(self.log_odds),
            None if self.weight is None else _locked(self.weight),
        )

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
        shapes |= {name: (n_points,) for name in ("log_odds", "weight") if getattr(self, name) is not None}
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(
                    f"{name} of a reading has shape {np.shape(getattr(self, name))}, expected {shape}."
                )
        for name, values in labels.items():
            if values.dtype != np.bool_:
                raise ValueError(f"{name} of a reading holds values of type {values.dtype}, expected bool.")


def _locked(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.setflags(write=False)
    return view

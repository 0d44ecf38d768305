"""A sensor whose points an erring reader labels: lesions missed, outlines that stray, blobs that are none."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..cone_sensor import ConeSensor
from ..reading import Reading
from ..sensor import SceneState, Sensor
from .false_blobs import false_blobs
from .lesion_views import lesion_of, outlined
from .reader_errors import ReaderErrors
from .shadows import is_shadowed


@dataclass(frozen=True, kw_only=True)
class ErringSensor(Sensor):
    """Sees the points that another sensor sees, and labels them as an erring reader would.

    The steps, in this order: what lies too deep or in a shadow is left out; each lesion is missed or outlined; false
    blobs are added; and labels of single points are flipped. The second class of a scene is read without error.
    """

    errors: ReaderErrors = field(default_factory=ReaderErrors)
    """What the reader gets wrong."""
    exact: Sensor = field(default_factory=ConeSensor)
    """The sensor whose points are read; its own labels of tumour are not looked at."""
    shadowing: tuple[str, ...] = ()
    """Names of the structures behind which nothing is seen."""

    def sense(self, state: SceneState, rng: np.random.Generator) -> Reading:
        """The points of the other sensor with the labels of the reader.

        Args:
            state: The scene now.
            rng: Draws the points, and seeds a stream for each kind of error, so that one kind does not change another.

        Raises:
            FieldError: `shadowing` names a structure that the anatomy has not.
        """
        reading = self.exact.sense(state, rng)
        lesions, blobs, flips = rng.spawn(3)
        reading, depths_m = self._seen(state, reading)
        points_m = reading.points_m
        is_tumour = np.zeros(len(points_m), dtype=bool)
        for solid in state.scene.anatomy.tumours:
            is_tumour |= outlined(lesion_of(solid), points_m, depths_m, self.errors, lesions)
        is_tumour |= false_blobs(points_m, self.errors, blobs)
        is_tumour ^= _flipped(is_tumour, self.errors, flips)
        return replace(reading, is_occupied=is_tumour)

    def _seen(self, state: SceneState, reading: Reading) -> tuple[Reading, NDArray[np.float64]]:
        """The reading without what lies too deep or in a shadow, and the depths of its points along the beam [m]."""
        T_world_probe = state.T_world_probe
        depths_m = (reading.points_m - T_world_probe[:3, 3]) @ T_world_probe[:3, 2]
        is_seen = depths_m <= self.errors.penetration_m
        is_seen &= ~is_shadowed(state, reading.points_m, self.shadowing)
        return reading.part(is_seen), depths_m[is_seen]


def _flipped(
    is_tumour: NDArray[np.bool_], errors: ReaderErrors, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Which labels of single points are wrong, shape (N,)."""
    rate = np.where(is_tumour, errors.flipped_tumour, errors.flipped_free)
    return rng.random(len(is_tumour)) < rate

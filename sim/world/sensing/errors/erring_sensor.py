"""A sensor whose points an erring reader labels: lesions missed, outlines that stray, blobs that are none."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

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
    blobs are added; labels of single points are flipped; and the pose that is believed strays from the true one, so
    that the points are told elsewhere than they are. The second class of a scene is read without error.
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
        lesions, blobs, flips, tracking = rng.spawn(4)
        reading, depths_m = self._seen(state, reading)
        points_m = reading.points_m
        is_tumour = np.zeros(len(points_m), dtype=bool)
        for solid in state.scene.anatomy.tumours:
            is_tumour |= outlined(lesion_of(solid), points_m, depths_m, self.errors, lesions)
        is_tumour |= false_blobs(points_m, self.errors, blobs)
        is_tumour ^= _flipped(is_tumour, self.errors, flips)
        return self._misplaced(state, replace(reading, is_occupied=is_tumour), tracking)

    def _seen(self, state: SceneState, reading: Reading) -> tuple[Reading, NDArray[np.float64]]:
        """The reading without what lies too deep or in a shadow, and the depths of its points along the beam [m]."""
        T_world_probe = state.T_world_probe
        depths_m = (reading.points_m - T_world_probe[:3, 3]) @ T_world_probe[:3, 2]
        is_seen = depths_m <= self.errors.penetration_m
        is_seen &= ~is_shadowed(state, reading.points_m, self.shadowing)
        return reading.part(is_seen), depths_m[is_seen]

    def _misplaced(self, state: SceneState, reading: Reading, rng: np.random.Generator) -> Reading:
        """The reading as it is told by a tracker that is off; what is told outside the organ is left out."""
        shift_m = self.errors.tracking_m * rng.standard_normal(3)
        turn = Rotation.from_rotvec(self.errors.tracking_rad * rng.standard_normal(3))
        if self.errors.tracking_m == 0.0 and self.errors.tracking_rad == 0.0:
            return reading
        T_world_probe = reading.T_world_probe.copy()
        tip_m = T_world_probe[:3, 3].copy()
        points_m = turn.apply(reading.points_m - tip_m) + tip_m + shift_m
        T_world_probe[:3, :3] = turn.as_matrix() @ T_world_probe[:3, :3]
        T_world_probe[:3, 3] += shift_m
        told = replace(reading, points_m=points_m, T_world_probe=T_world_probe)
        return told.part(state.scene.anatomy.is_inside_organ(points_m))


def _flipped(
    is_tumour: NDArray[np.bool_], errors: ReaderErrors, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Which labels of single points are wrong, shape (N,)."""
    rate = np.where(is_tumour, errors.flipped_tumour, errors.flipped_free)
    return rng.random(len(is_tumour)) < rate

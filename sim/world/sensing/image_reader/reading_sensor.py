"""The sensor whose pictures a reader reads: the points of a sweep with the labels that its pictures show."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..reading import Reading
from ..sensor import SceneState, Sensor
from ..ultrasound.ultrasound_sensor import UltrasoundSensor
from .image_reader import ImageReader

MOST_LOG_ODDS = 8.0
"""No label is believed further: the reader was calibrated on some hundred lesions."""
TOGETHER_M = 0.008
"""Labels of one view that lie within this distance err together [m]."""


@dataclass(frozen=True, kw_only=True)
class ReadingSensor(Sensor):
    """Sweeps as another sensor does, and labels the points by what a reader sees in the pictures alone.

    The second class of a scene is labelled without error.
    """

    ultrasound: UltrasoundSensor = field(default_factory=UltrasoundSensor)
    """What draws the pictures."""
    reader: ImageReader = field(default_factory=ImageReader)
    """What reads them."""
    tells_doubt: bool = True
    """Whether a reading says how far each label can be believed."""

    def sense(self, state: SceneState, rng: np.random.Generator) -> Reading:
        """The points of a sweep that were seen, with the reader's labels.

        Args:
            state: The scene now.
            rng: Draws the points and the noise.
        """
        reading = self.ultrasound.sense(state, rng)
        sweep = reading.images
        assert sweep is not None
        seen = self.reader.read(sweep, self.ultrasound.array_of(state.cone))
        log_odds = seen.at(sweep, reading.points_m)
        sweep = replace(sweep, middle_lesions=seen.picture(sweep, sweep.middle))
        reading = replace(reading, is_occupied=log_odds > 0.0, images=sweep)
        if not self.tells_doubt:
            return reading
        told = np.clip(log_odds - self.reader.weights.prior_log_odds, -MOST_LOG_ODDS, MOST_LOG_ODDS)
        # Between the odds of any cell and one half a point is called free though it speaks for tumour: it says nothing.
        told = np.where(reading.is_occupied, np.maximum(told, 0.0), np.minimum(told, 0.0))
        weight = 1.0 / _n_together(reading.points_m, reading.is_occupied)
        return replace(reading, log_odds=told, weight=weight)


def _n_together(points_m: NDArray[np.float64], is_occupied: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The number of labels that agree with each within `TOGETHER_M`, itself included, shape (N,)."""
    count = np.ones(len(points_m), dtype=np.int64)
    for kind in (True, False):
        own = np.flatnonzero(is_occupied == kind)
        if own.size:
            tree = KDTree(points_m[own])
            count[own] = tree.query_ball_point(points_m[own], TOGETHER_M, return_length=True)
    return count

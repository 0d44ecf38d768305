"""What a sweep's points are labelled as: the place where readers that err come in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.world.sensing.sensor import PointLabels, SceneState
from sim.world.sensing.sweep import Sweep


def exact_labels(sweep: Sweep, points_m: NDArray[np.float64], state: SceneState) -> PointLabels:
    """What lies at the points of a sweep, without error.

    Args:
        sweep: The pictures, which an exact reader has no need of.
        points_m: Points that were seen, world frame [m], shape (N, 3).
        state: The scene, and with it the truth.
    """
    return state.labels(points_m)

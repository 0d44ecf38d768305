"""The measures of episodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SENSED_GOAL = 0.95
"""The paper's measure of detection: the tumours count as detected when this share of their points was sensed."""
ACTION_SECONDS = ("plan_s", "ik_s", "move_s", "sense_s", "update_s")
"""Columns of the computing time of an action, which differs from run to run."""
FirstSteps = NDArray[np.int64]
"""The action, from 1, at which something first happened to each of some points; `NEVER` where it did not."""
NEVER = int(np.iinfo(np.int64).max)


def never(n_points: int) -> FirstSteps:
    """Points to which nothing has happened yet, shape (n_points,)."""
    return np.full(n_points, NEVER, dtype=np.int64)


def note_first(first: FirstSteps, step: int, happens: NDArray[np.bool_]) -> None:
    """Write an action to the points to which something happens for the first time."""
    np.minimum(first, step, out=first, where=happens)

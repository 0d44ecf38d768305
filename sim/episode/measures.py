"""The measures of episodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner import Cone

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


def note_held(
    first: FirstSteps,
    step: int,
    cone: Cone,
    points_m: NDArray[np.float64],
    T_world_probe: NDArray[np.float64],
) -> None:
    """Write an action to the points that its cone holds for the first time.

    Args:
        first: The action of each point, shape (N,), which is changed.
        step: The action, from 1.
        cone: What an action senses.
        points_m: The points [m], shape (N, 3).
        T_world_probe: Where the probe's tip is, shape (4, 4).
    """
    note_first(first, step, cone.contains(points_m, T_world_probe[:3, 3], T_world_probe[:3, 2]))

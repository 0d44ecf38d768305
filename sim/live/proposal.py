"""A proposal: where the planner would sense next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Proposal:
    """The pose that the planner would sense from next, and how things stand."""

    number: int
    """Number of the sensing action, from 1."""
    pose_index: int | None
    """The pose's index in the workspace; None where no pose is left."""
    T_world_probe: NDArray[np.float64] | None
    """Pose of the probe's tip, whose +z is the beam, shape (4, 4) [m]; the turn about the beam is free. None where no
    pose is left."""
    confidence: float | None
    """How sure the planner is that nothing is left; None where it does not tell."""
    advice: str
    """`sense`, or why to end: `confident`, `not_worth` or `no_pose_left`. It is advice: who senses on is served."""
    plan_s: float
    """Time that planning took [s]."""

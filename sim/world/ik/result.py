"""The answer of one IK solve: status, joint positions, errors and effort."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray


class IkStatus(Enum):
    """How an IK solve ended; the value is a sentence that names the remedy."""

    REACHED = "The pose is reached."
    TOO_FAR = "The pose lies beyond the stretched arm; move the base or the organ closer."
    JOINT_LIMIT = "The arm ran into its joint limits; move the base, or choose a pose with another normal."
    AXIS = (
        "The tip gets there, but the beam cannot be turned along the normal; allow a tilt, or move the base."
    )
    COLLISION = "Every answer found collides; move the base or the organ, or choose another pose."
    NOT_CONVERGED = "No answer was found; allow more restarts, or choose another pose."


@dataclass(frozen=True, eq=False)
class IkResult:
    """The answer of one IK solve: status, errors and effort."""

    status: IkStatus
    q: NDArray[np.float64]
    """Joint positions at the pose (the best found where it is not reached), shape (n_joints,)."""
    q_standoff: NDArray[np.float64]
    """Joint positions at the stand-off above the pose; equal to `q` where that was never solved."""
    position_error_m: float
    angle_error_rad: float
    n_iterations: int
    n_restarts: int
    detail: str = ""
    """What stood in the way: the joint at its limit, the pair in collision."""

    @property
    def is_reached(self) -> bool:
        """Whether pose and stand-off are reached without a forbidden contact."""
        return self.status is IkStatus.REACHED

    def explain(self) -> str:
        """One sentence for a person."""
        return f"{self.status.value} {self.detail}".strip()

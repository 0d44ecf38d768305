"""What an agent sees: the course of the episode so far, as arrays of fixed size, and the spaces that they lie in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.world.optional import optional_module

spaces = optional_module("gymnasium.spaces", "gym", "`sim.gym`")

NO_POSE = -1
"""Stands for a pose where there is none: before the first action, and in the part of the history still to come."""


def observation_space(n_actions: int, max_steps: int, lattice_shape: tuple[int, int, int] | None) -> Any:
    """The space of the observations.

    Args:
        n_actions: Number of actions.
        max_steps: Most actions of an episode.
        lattice_shape: Shape of the belief; None where no map is kept.
    """
    parts = {
        "action_mask": spaces.MultiBinary(n_actions),
        "last_pose": spaces.Discrete(n_actions + 1, start=NO_POSE),
        "share_used": spaces.Box(0.0, 1.0, (1,), np.float32),
        "history": spaces.Box(NO_POSE, n_actions - 1, (max_steps,), np.int64),
        "tumour_in_cone": spaces.MultiBinary(max_steps),
    }
    if lattice_shape is not None:
        parts["belief"] = spaces.Box(0.0, 1.0, lattice_shape, np.float32)
    return spaces.Dict(parts)


class History:
    """The actions of one episode so far."""

    def __init__(self, is_open: NDArray[np.bool_], max_steps: int) -> None:
        """Start before the first action.

        Args:
            is_open: Which actions lead to a pose that is reached, shape (n_actions,).
            max_steps: Most actions of an episode.
        """
        self._mask = is_open.astype(np.int8)
        self._poses = np.full(max_steps, NO_POSE, dtype=np.int64)
        self._is_met = np.zeros(max_steps, dtype=np.int8)
        self._last, self.n_sensed, self.n_actions = NO_POSE, 0, 0

    def note_missed(self, pose: int) -> None:
        """Note an action at a pose that is out of reach, which counts but gives no reading."""
        self._mask[pose] = 0
        self.n_actions += 1

    def note_sensed(self, pose: int, *, is_tumour_in_cone: bool) -> None:
        """Note an action with its reading."""
        self._mask[pose] = 0
        self._poses[self.n_sensed], self._is_met[self.n_sensed] = pose, is_tumour_in_cone
        self._last = pose
        self.n_sensed += 1
        self.n_actions += 1

    def observation(self) -> dict[str, Any]:
        """The parts of an observation that need no map, fresh copies."""
        return {
            "action_mask": self._mask.copy(),
            "last_pose": np.int64(self._last),
            "share_used": np.array([self.n_actions / len(self._poses)], dtype=np.float32),
            "history": self._poses.copy(),
            "tumour_in_cone": self._is_met.copy(),
        }

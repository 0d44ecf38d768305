"""A planner that goes to recorded poses, by which a submission is replayed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

from planner import Planner, Situation

TEXT = f"{__name__}:RecordedPoses"
"""The text that names the planner."""


class RecordedPoses(Planner):
    """Goes to one pose after the other, and looks at nothing."""

    needs_belief: ClassVar[bool] = False

    def __init__(self, poses: Sequence[int]) -> None:
        """Go to `poses`, in their order."""
        self._poses = tuple(poses)

    def rank(self, situation: Situation) -> Iterator[int]:
        """The next pose alone: where the probe does not get there, the record is wrong, and the episode ends."""
        n_gone = len(situation.sensed)
        # A pose that was skipped is not offered again.
        if n_gone < len(self._poses) and self._poses[n_gone] not in situation.skipped:
            yield self._poses[n_gone]

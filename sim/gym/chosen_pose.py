"""The planner of an episode whose poses somebody else chooses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from planner import Planner, Situation


class ChosenPose(Planner):
    """Ranks one pose, which is set before each action; unlike other planners it serves one episode alone."""

    needs_belief: ClassVar[bool] = False

    def __init__(self) -> None:
        """Start with pose 0."""
        self.pose = 0
        """The index of the pose to sense from next."""

    def rank(self, situation: Situation) -> Iterator[int]:
        """See `Planner.rank`: the chosen pose and no other."""
        del situation
        yield self.pose

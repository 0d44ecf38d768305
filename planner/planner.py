"""What every planner is: a ranking of the workspace's poses."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Literal

from .situation import Situation


class Planner(ABC):
    """Ranks sensing poses; it holds settings alone, so that one planner serves any number of episodes."""

    preferred_map: ClassVar[Literal["paper", "calibrated"]] = "calibrated"
    """Which of the map's settings the planner was made for."""
    needs_belief: ClassVar[bool]
    """Whether the ranking looks at the prediction; if not, an episode may leave the map out."""

    @abstractmethod
    def rank(self, situation: Situation) -> Iterator[int]:
        """Pose indices, best first, each at most once and never one that was skipped.

        The caller takes the first that the arm reaches. The ranking is lazy: what is never asked for is
        hardly computed. It ends when no pose is left.

        Args:
            situation: What is known so far.

        Raises:
            PlannerError: If the planner needs a belief and the situation has none.
        """

    def confidence(self, situation: Situation) -> float:
        """How sure the planner is that nothing is left to find or to outline; 0 for those that cannot tell.

        Args:
            situation: What is known so far.
        """
        return 0.0

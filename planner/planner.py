"""What every planner is: a ranking of the workspace's poses."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar

from .situation import Situation


class Planner(ABC):
    """Ranks sensing poses; it holds settings alone, so that one planner serves any number of episodes."""

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

"""What every planner is: a ranking of the workspace's poses. One of one's own derives from `Planner`."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Literal

from .situation import Situation
from .stopping.what_is_left import WhatIsLeft


class Planner(ABC):
    """A ranking of sensing poses. A planner holds nothing but settings, so that it serves any number of episodes."""

    preferred_map: ClassVar[Literal["paper", "calibrated"]] = "calibrated"
    """The map's settings for which the planner was made: the paper's, or those whose probabilities are calibrated."""
    needs_belief: ClassVar[bool]
    """Whether the ranking looks at the prediction; an episode may leave the map out where it does not."""
    needs_readings: ClassVar[bool] = False
    """Whether the ranking looks at the points of the readings though it needs no belief; for other planners a campaign
    without a map casts no rays, so that readings hold no points."""

    @abstractmethod
    def rank(self, situation: Situation) -> Iterator[int]:
        """The indices of poses, best first, each at most once and never one that was skipped.

        The caller takes the first that the arm reaches. The ranking is lazy, so that what the caller does not take
        costs next to nothing. It ends when no pose is left.

        Args:
            situation: What is known so far.

        Raises:
            PlannerError: If the planner needs a belief and the situation has none.
        """

    def paths(self, situation: Situation) -> Iterator[tuple[int, ...]]:
        """The paths over the surface to try, best first: of a planner of poses each is one pose of its ranking.

        The probe glides from where it is, `situation.sensed[-1]`, to each pose of a path by the shortest way on
        `situation.roadmap`, and reads on the way. The caller takes the first path whose last pose the arm reaches, and
        asks again after it.

        Args:
            situation: What is known so far, with a roadmap.

        Yields:
            Indices of poses in the order in which they are passed; at least one, and the last is none that was skipped.
        """
        return ((pose,) for pose in self.rank(situation))

    @property
    def tells_confidence(self) -> bool:
        """Whether the planner can tell how sure it is that nothing is left."""
        return type(self).confidence is not Planner.confidence

    def confidence(self, situation: Situation) -> float:
        """How sure the planner is, from 0 to 1, that nothing is left to find or to outline; 0 if it cannot tell.

        Args:
            situation: What is known so far.
        """
        return 0.0

    @property
    def weighs_cost(self) -> bool:
        """Whether the planner can tell when to go on is not worth the actions."""
        return type(self).is_worth_going_on is not Planner.is_worth_going_on

    def is_worth_going_on(self, situation: Situation) -> bool:
        """Whether more actions are worth it, where a missed lesion is worth `situation.miss_cost` of them.

        Args:
            situation: What is known so far.
        """
        return True

    def what_is_left(self, situation: Situation) -> WhatIsLeft | None:
        """The lesions that are expected to be left; None where the planner cannot tell.

        Args:
            situation: What is known so far.
        """
        return None

"""Lookahead: a planner that needs no belief ranks ahead of time, so that the arm solves many poses at once.

A search for many poses together takes a tenth of the time of one after the other, and a pose's answer is the same
either way. A planner that looks at no map ranks the same whatever the readings say. So it can rank in advance, with a
copy of its generator and as if the arm reached every pose. Where the arm does not, only time is lost.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator
from time import perf_counter
from typing import ClassVar

from planner import Planner, Situation, WhatIsLeft
from sim.episode.planned.checks import checked_poses
from sim.episode.positioner import Positioner

N_AHEAD = 32
"""Poses that are solved together: more would cost little less each, and more would be in vain when an episode ends."""


class Lookahead(Planner):
    """A planner that ranks as another one does, and has the positioner prepare the poses that will come."""

    needs_belief: ClassVar[bool] = False

    def __init__(self, planner: Planner, positioner: Positioner) -> None:
        """Rank as `planner`, which needs no belief, and prepare on `positioner`."""
        self.stands_for, self._positioner = planner, positioner
        self.prepare_s = 0.0
        """Time that the positioner took to prepare poses [s]."""

    def rank(self, situation: Situation) -> Iterator[int]:
        """The planner's own ranking."""
        ranking = checked_poses(self.stands_for, self.stands_for.rank(situation), situation.workspace.n_poses)
        for pose in ranking:
            if not self._positioner.is_prepared(pose):
                poses = [pose, *self._next_poses(situation, pose)]
                start_s = perf_counter()
                self._positioner.prepare(poses)
                self.prepare_s += perf_counter() - start_s
            yield pose

    @property
    def tells_confidence(self) -> bool:
        """Whether the planner itself can tell."""
        return self.stands_for.tells_confidence

    def confidence(self, situation: Situation) -> float:
        """The planner's own confidence."""
        return self.stands_for.confidence(situation)

    @property
    def weighs_cost(self) -> bool:
        """Whether the planner itself can tell."""
        return self.stands_for.weighs_cost

    def is_worth_going_on(self, situation: Situation) -> bool:
        """Whether more actions are worth it to the planner itself."""
        return self.stands_for.is_worth_going_on(situation)

    def what_is_left(self, situation: Situation) -> WhatIsLeft | None:
        """What the planner itself expects to be left."""
        return self.stands_for.what_is_left(situation)

    def _next_poses(self, situation: Situation, pose: int) -> list[int]:
        """The poses that the planner will choose after `pose`, if all are reached."""
        rng = copy.deepcopy(situation.rng)
        ahead: list[int] = []
        while len(ahead) < N_AHEAD - 1:
            later = dataclasses.replace(situation, sensed=(*situation.sensed, pose, *ahead), rng=rng)
            try:
                first = next(iter(self.stands_for.rank(later)), None)
            # A planner may not bear a situation that never came, with poses sensed but not yet read. What it raises in
            # the situations that do come is raised there.
            except (Exception, SystemExit):
                first = None
            if first is None:
                break
            ahead.append(first)
        return ahead

"""The planner find-and-outline: it searches where most could still hide, and covers what was found to its edge."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import PlannerError
from ..planner import Planner
from ..situation import Situation
from ..stopping.confidence import (
    balls_in_question,
    certainty_score,
    chance_of_none_left,
    seeks_certainty,
    share_known_free,
)
from ..stopping.expectation import is_worth_searching, what_is_left
from ..stopping.lesion_count import label_spacing_m, n_lesions
from ..stopping.lesion_prior import LesionPrior
from ..stopping.what_is_left import WhatIsLeft
from .faint_findings import faint_score
from .fine_lattice import FineLattice, fine_lattice, likely_m3
from .frontier import likely_tumour_m, probability_at, seen_weight, sensed_points, unconfirmed_points
from .hidden_balls import BallPrior, HiddenBalls, hidden_balls
from .rims import rim_score
from .suspects import suspects
from .tour import MAX_STOPS, shortest_tour

_FAILURE_RADIUS_M = 0.008
"""Poses this near to one that the arm failed to reach are likely to fail too."""
_AFTER_FAILURE = 0.5
"""Factor of such a pose's score for every failure near it."""
_CANDIDATE_GAP_M = 0.02
"""Where ways count, the best pose of each cube of this side is a candidate [m]."""
_N_AHEAD = 8
"""Poses of a search that are weighed together, before it is given up as not worth its actions."""


@dataclass(frozen=True, kw_only=True)
class FindAndOutline(Planner):
    """Ranks by the tumour volume that a pose is expected to newly see: found by a search, or outlined."""

    needs_belief: ClassVar[bool] = True

    margin_m: float = 0.007
    """Unsensed places within this distance of likely tumour may belong to it [m]."""
    floor: float = 0.15
    """Least probability that such a place is given: the map's edges are not sharp enough to deny it."""
    least_gain_m3: float = 5e-8
    """Expected tumour volume that a pose has to add to be worth an outlining action [m^3]."""
    hidden_m3: float = 6e-6
    """Tumour volume that a search of the whole organ is expected to find [m^3]: weighs finding against outlining."""
    hidden_ratio: float = 1.0
    """What it is expected to find beyond that, as a share of the volume found so far: where much was, more may be."""
    faint_share: float = 0.1
    """What a look at a faint finding is worth, as a share of what a search of the whole organ is expected to find."""
    fading: float = 0.03
    """Factor of a ball's weight for each time that a pose looked at it and found nothing; at least the chance with
    which the sensor is believed to miss a lesion."""
    travel_weight: float = 0.0
    """How much a second of transfer counts against one of sensing: 0 for the fewest actions, more for shorter ways."""
    batch: int = 1
    """Number of poses that the search chooses together; it goes to the first one on the shortest way through them."""
    sure_radius_m: float = 0.008
    """Radius of the smallest tumours of which the confidence says that none is left [m]."""
    balls: BallPrior = field(default_factory=BallPrior)
    """The balls that the search takes to be possible."""
    lesions: LesionPrior = field(default_factory=LesionPrior)
    """The lesions that are expected before anything is sensed; only what is left, and its worth, go by them."""

    def __post_init__(self) -> None:
        """Checks the ranges."""
        for name in ("margin_m", "least_gain_m3", "hidden_m3", "sure_radius_m"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise PlannerError(f"`{name}` must be above 0 and finite, got {getattr(self, name)}")
        for name in ("floor", "fading"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise PlannerError(f"`{name}` must lie in 0 .. 1, 1 excluded, got {getattr(self, name)}")
        for name in ("hidden_ratio", "faint_share", "travel_weight"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise PlannerError(f"`{name}` must be 0 or above and finite, got {getattr(self, name)}")
        if not 1 <= self.batch <= MAX_STOPS:
            raise PlannerError(f"`batch` must be 1 to {MAX_STOPS}, got {self.batch}")

    def rank(self, situation: Situation) -> Iterator[int]:
        """The poses by the tumour volume that they outline and are expected to find, most first.

        Poses near one that fails while the ranking is read come later than they would have. See `Planner.rank`.
        """
        workspace = situation.workspace
        is_left = situation.available(exclude_sensed=True)
        score = (
            self.score(situation) if self._is_worth_searching(situation) else self.outline_score(situation)
        )
        _heed_failures(score, situation)
        score[~is_left] = -1.0
        by_way = iter(self._by_way(situation, score))
        for _ in range(int(is_left.sum())):
            pose = next(by_way, int(np.argmax(score)))
            yield pose
            score[workspace.within(pose, _FAILURE_RADIUS_M)] *= _AFTER_FAILURE
            score[pose] = -1.0

    def _by_way(self, situation: Situation, score: NDArray[np.float64]) -> list[int]:
        """The poses to try first because of the way to them; none where ways do not count."""
        if (self.travel_weight == 0.0 and self.batch == 1) or not situation.sensed:
            return []
        if self.batch > 1 and not self._is_worth_outlining(self.outline_score(situation), situation):
            return self._tour(situation, score >= 0.0)
        if self.travel_weight == 0.0:
            return []
        poses = situation.workspace.best_apart(score, _CANDIDATE_GAP_M)
        seconds = situation.seconds_to(poses)
        merit = score[poses] / (situation.sensing_s + self.travel_weight * seconds)
        order = np.argsort(-merit, kind="stable")
        return [int(poses[i]) for i in order if np.isfinite(seconds[i]) and merit[i] > 0.0]

    def _tour(self, situation: Situation, is_left: NDArray[np.bool_]) -> list[int]:
        """The batch of poses that together find most, chosen greedily, in the order of the shortest way."""
        chosen = list(islice(self._search_plan(situation, is_left), self.batch))
        poses = np.array(chosen)
        places_m = situation.workspace.positions_m[poses]
        between_m = np.linalg.norm(places_m[:, None] - places_m, axis=2)
        last_m = situation.workspace.positions_m[situation.sensed[-1]]
        return [chosen[i] for i in shortest_tour(np.linalg.norm(places_m - last_m, axis=1), between_m)]

    def _search_plan(self, situation: Situation, is_left: NDArray[np.bool_]) -> Iterator[int]:
        """The poses that a search takes one after the other as long as it finds nothing."""
        chosen: list[int] = []
        while len(chosen) < is_left.sum():
            score = self.search_score(replace(situation, sensed=(*situation.sensed, *chosen)))
            _heed_failures(score, situation)
            score[~is_left] = -1.0
            score[chosen] = -1.0
            chosen.append(int(np.argmax(score)))
            yield chosen[-1]

    def _is_worth_searching(self, situation: Situation) -> bool:
        """Whether the next poses of the search are worth it; they are where nobody says what a miss costs."""
        if situation.miss_cost is None or not situation.sensed:
            return True
        plan = islice(self._search_plan(situation, situation.available(exclude_sensed=True)), _N_AHEAD)
        found = self._n_found(situation)
        return is_worth_searching(situation, self.lesions, found, plan, situation.miss_cost)

    def _is_worth_outlining(self, outline: NDArray[np.float64], situation: Situation) -> bool:
        """Whether some pose that is left outlines enough."""
        is_left = situation.available(exclude_sensed=True)
        return float(np.max(outline, where=is_left, initial=0.0)) >= self.least_gain_m3

    def score(self, situation: Situation) -> NDArray[np.float64]:
        """The tumour volume that each pose is expected to newly see, outlined or found [m^3], shape (N,), 0 or above.

            score = V (search + c faint) + outline + rim,   V = hidden_m3 + hidden_ratio F,   c = faint_share

        F is the volume of likely tumour, and faint counts findings without extent, see `faint_score`.

        An outline below `least_gain_m3` counts as none. What is in doubt at rims counts where views may be wrong, see
        `rim_score`, but not where an episode seeks to be sure.

        Args:
            situation: What is known so far.
        """
        share = self.search_score(situation)
        if not situation.sensed:
            return self.hidden_m3 * share
        outlined_m3 = self.outline_score(situation)
        hidden_m3 = self.hidden_m3 + self.hidden_ratio * likely_m3(situation)
        found_m3 = hidden_m3 * share + np.where(outlined_m3 >= self.least_gain_m3, outlined_m3, 0.0)
        if self._seeks_certainty(situation):
            return found_m3
        lattice = fine_lattice(situation.search_points_m)
        if self.faint_share > 0.0:
            found_m3 += hidden_m3 * self.faint_share * faint_score(situation, lattice)
        return found_m3 + rim_score(situation, lattice, _probability(lattice, situation))

    def search_score(self, situation: Situation) -> NDArray[np.float64]:
        """The share of what could still hide that each pose would find, shape (N,).

            search = sum over balls b that the pose finds of  w_b fading^(times b was found)

        An episode that seeks to be sure searches for what keeps it from that, see `stopping.confidence`.

        Args:
            situation: What is known so far.
        """
        if self._seeks_certainty(situation):
            return certainty_score(self._in_question(situation), situation)
        workspace, points_m = situation.workspace, situation.search_points_m
        balls = hidden_balls(workspace, situation.cone, points_m, situation.surface_distance_m, self.balls)
        fading = max(self.fading, situation.missed_rate)
        left = balls.weights * fading ** balls.times_found(situation.sensed)
        return balls.newly_found(left.astype(np.float32)).astype(np.float64)

    def outline_score(self, situation: Situation) -> NDArray[np.float64]:
        """The expected tumour volume in and beside what was found that each pose would newly see [m^3], shape (N,).

            outline = v sum over open points x in the pose's cone of  max(p(x), floor),   v the volume of a cell

        Args:
            situation: What is known so far.
        """
        cell_m3 = fine_lattice(situation.search_points_m).cell_m3
        return cell_m3 * seen_weight(situation.workspace, situation.cone, *self.open_points(situation))

    def open_points(self, situation: Situation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The points that are left to outline [m], shape (F, 3), and how likely each is tumour, shape (F,).

        They lie within `margin_m` of likely tumour and in no cone so far. Where views may be wrong, a finding that is
        not confirmed yet is open for some looks more, see `unconfirmed_points` and `suspects`.
        """
        workspace, cone = situation.workspace, situation.cone
        lattice = fine_lattice(situation.search_points_m)
        probability = _probability(lattice, situation)
        suspected = suspects(situation, lattice.points_m[probability > 0.5], self.margin_m)
        likely_m = np.concatenate([likely_tumour_m(lattice, probability, situation), suspected.points_m])
        around = lattice.near(likely_m, self.margin_m)
        points_m = lattice.points_m[around]
        is_open = ~sensed_points(workspace, cone, situation.sensed, points_m)
        if situation.missed_rate > 0.0:
            is_open |= unconfirmed_points(situation, points_m, probability[around], self.margin_m)
        chance = suspected.chance_at(points_m)
        is_open |= chance > 0.0
        weights = np.maximum(np.maximum(probability[around], chance), self.floor)[is_open]
        return points_m[is_open], weights

    def confidence(self, situation: Situation) -> float:
        """The probability that no tumour of `sure_radius_m` or more is left to find; 0 while one is left to outline.

        That is C^(k + 1), see `chance_of_none_left`. Of the tumours of at least that radius the smallest hide best, so
        C is the share of balls hardly larger.

        Args:
            situation: What is known so far.
        """
        if not situation.sensed or self._is_worth_outlining(self.outline_score(situation), situation):
            return 0.0
        share = share_known_free(self._in_question(situation), situation)
        return chance_of_none_left(self._n_found(situation), share)

    def is_worth_going_on(self, situation: Situation) -> bool:
        """Whether some pose outlines enough, or the next poses of the search are worth their actions.

        Args:
            situation: What is known so far.
        """
        if not situation.sensed or self._is_worth_outlining(self.outline_score(situation), situation):
            return True
        return self._is_worth_searching(situation)

    def what_is_left(self, situation: Situation) -> WhatIsLeft:
        """The lesions that are expected to be left, see `stopping.expectation.what_is_left`.

        Args:
            situation: What is known so far.
        """
        return what_is_left(situation, self.lesions, self._n_found(situation))

    def _n_found(self, situation: Situation) -> int:
        """The number of lesions found, which are clusters of likely tumour."""
        lattice = fine_lattice(situation.search_points_m)
        tumour_m = likely_tumour_m(lattice, _probability(lattice, situation), situation)
        labels_m = label_spacing_m(situation.cone, situation.readings)
        free_m = [reading.points_m[~reading.is_occupied] for reading in situation.readings]
        spacing_m = max(lattice.cell_m3 ** (1.0 / 3.0), labels_m)
        return n_lesions(tumour_m, np.concatenate([np.empty((0, 3)), *free_m]), spacing_m)

    def _seeks_certainty(self, situation: Situation) -> bool:
        """Whether the search goes after what keeps the episode from stopping."""
        return seeks_certainty(situation, self.balls, self.sure_radius_m)

    def _in_question(self, situation: Situation) -> HiddenBalls:
        return balls_in_question(situation, self.balls, self.sure_radius_m)


def _heed_failures(score: NDArray[np.float64], situation: Situation) -> None:
    """Lowers the scores, in place, of poses near those that the arm failed to reach."""
    for failed in situation.skipped:
        score[situation.workspace.within(failed, _FAILURE_RADIUS_M)] *= _AFTER_FAILURE


def _probability(lattice: FineLattice, situation: Situation) -> NDArray[np.float64]:
    return probability_at(lattice, situation.belief("find-and-outline"))

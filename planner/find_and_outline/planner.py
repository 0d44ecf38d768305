"""Find and outline: search where most could still hide, and cover what was found to its edge."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from mapping import Prediction

from ..errors import PlannerError
from ..planner import Planner
from ..situation import Situation
from .fine_lattice import FineLattice, fine_lattice
from .frontier import n_clusters, probability_at, seen_weight, sensed_points
from .hidden_balls import BallPrior, HiddenBalls, hidden_balls, still_hiding
from .tour import MAX_STOPS, shortest_tour

_FAILURE_RADIUS_M = 0.008
"""Poses this near to one that the arm failed to reach are likely to fail too."""
_AFTER_FAILURE = 0.5
"""What such a pose's score is worth, for every failure near it."""
_CANDIDATE_GAP_M = 0.02
"""Where ways count, the best pose of each cube of this side is looked at [m]."""
_CLUSTER_GAP_M = 0.01
"""Likely tumour farther apart than about this counts as two tumours [m]."""
_SURE_RADIUS_RATIO = 1.25
"""The largest of the balls that confidence is about is this much larger than the smallest."""


@dataclass(frozen=True, kw_only=True)
class FindAndOutline(Planner):
    """Two jobs, weighed in one unit: the tumour volume that a pose is expected to newly see."""

    needs_belief: ClassVar[bool] = True

    margin_m: float = 0.007
    """Unsensed places within this distance of likely tumour may belong to it [m]."""
    floor: float = 0.15
    """Least probability granted to such a place: the map's edges are not sharp enough to deny it."""
    least_gain_m3: float = 5e-8
    """Expected tumour volume that a pose has to add to be worth an outlining action [m^3]."""
    hidden_m3: float = 6e-6
    """Tumour volume that a search of the whole organ is expected to find [m^3]: weighs finding against outlining."""
    hidden_ratio: float = 1.0
    """What it is expected to find besides, as a share of the volume found so far: where much was, more may be."""
    fading: float = 0.03
    """What a ball still counts each time that it was looked at and nothing was found."""
    travel_weight: float = 0.0
    """How much a second of transfer counts against one of sensing: 0 for the fewest actions, more for shorter ways."""
    batch: int = 1
    """Poses that the search chooses together at each action, to go to the first of the shortest way through them."""
    sure_radius_m: float = 0.008
    """Confidence that nothing is left speaks of tumours of this radius and more [m]."""
    balls: BallPrior = field(default_factory=BallPrior)
    """What the search takes for possible."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("margin_m", "least_gain_m3", "hidden_m3", "sure_radius_m"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise PlannerError(f"{name} must be above 0 and finite, got {getattr(self, name)}")
        for name in ("floor", "fading"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise PlannerError(f"{name} must lie in 0 .. 1, 1 excluded, got {getattr(self, name)}")
        for name in ("hidden_ratio", "travel_weight"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise PlannerError(f"{name} must be 0 or above and finite, got {getattr(self, name)}")
        if not 1 <= self.batch <= MAX_STOPS:
            raise PlannerError(f"batch must be 1 to {MAX_STOPS}, got {self.batch}")

    def rank(self, situation: Situation) -> Iterator[int]:
        """The poses by the tumour volume that they outline and are expected to find, most first.

        Poses near one that fails while the ranking is read come later than they would have.
        """
        workspace = situation.workspace
        is_left = situation.available(exclude_sensed=True)
        score = self.score(situation)
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
        """The batch of poses that together find most, greedily chosen, in the order of the shortest way."""
        chosen: list[int] = []
        for _ in range(min(self.batch, int(is_left.sum()))):
            score = self.search_score(replace(situation, sensed=(*situation.sensed, *chosen)))
            _heed_failures(score, situation)
            score[~is_left] = -1.0
            score[chosen] = -1.0
            chosen.append(int(np.argmax(score)))
        poses = np.array(chosen)
        places_m = situation.workspace.positions_m[poses]
        between_m = np.linalg.norm(places_m[:, None] - places_m, axis=2)
        last_m = situation.workspace.positions_m[situation.sensed[-1]]
        return [chosen[i] for i in shortest_tour(np.linalg.norm(places_m - last_m, axis=1), between_m)]

    def _is_worth_outlining(self, outline: NDArray[np.float64], situation: Situation) -> bool:
        """Whether some pose that is left outlines enough."""
        is_left = situation.available(exclude_sensed=True)
        return float(np.max(outline, where=is_left, initial=0.0)) >= self.least_gain_m3

    def score(self, situation: Situation) -> NDArray[np.float64]:
        """Tumour volume that each pose is expected to newly see, outlined or found [m^3], shape (N,), 0 or above."""
        share = self.search_score(situation)
        if not situation.sensed:
            return self.hidden_m3 * share
        outlined_m3 = self.outline_score(situation)
        hidden_m3 = self.hidden_m3 + self.hidden_ratio * _likely_m3(situation)
        return hidden_m3 * share + np.where(outlined_m3 >= self.least_gain_m3, outlined_m3, 0.0)

    def search_score(self, situation: Situation) -> NDArray[np.float64]:
        """Share of what could still hide that each pose would find, shape (N,)."""
        balls = self._hidden(situation)
        left = balls.weights * self.fading ** balls.times_found(situation.sensed)
        return balls.newly_found(left.astype(np.float32)).astype(np.float64)

    def outline_score(self, situation: Situation) -> NDArray[np.float64]:
        """Tumour volume in and beside what was found that each pose would newly see [m^3], expected, shape (N,)."""
        workspace, cone = situation.workspace, situation.cone
        lattice = fine_lattice(situation.search_points_m)
        probability = _probability(lattice, situation)
        around = lattice.near(_likely_tumour_m(lattice, probability, situation), self.margin_m)
        points_m = lattice.points_m[around]
        is_open = ~sensed_points(workspace, cone, situation.sensed, points_m)
        weights = np.maximum(probability[around], self.floor)[is_open]
        return lattice.cell_m3 * seen_weight(workspace, cone, points_m[is_open], weights)

    def confidence(self, situation: Situation) -> float:
        """Probability that no tumour of the radius or more is left to find; 0 while one is left to outline.

        The number of tumours is Poisson of unknown rate, any rate being as likely as any other. With k found among
        the share C of what could hide, the rate is Gamma(k + 1, C), and none is left with probability C^(k + 1).
        Of tumours of at least a radius the smallest hide best, so C is that of balls hardly larger.
        """
        if not situation.sensed or self._is_worth_outlining(self.outline_score(situation), situation):
            return 0.0
        range_m = (self.sure_radius_m, _SURE_RADIUS_RATIO * self.sure_radius_m)
        prior = replace(self.balls, radius_range_m=range_m, overlap_share=0.5, radius_power=0.0)
        balls = self._hidden(situation, prior)
        hiding = still_hiding(
            balls, situation.readings, situation.false_negative_rate, situation.false_positive_rate
        )
        is_left = situation.available(exclude_sensed=True)
        is_findable = (hiding < balls.weights) | (balls.finds.T @ is_left.astype(np.float32) > 0)
        share = 1.0 - hiding[is_findable].sum() / max(balls.weights[is_findable].sum(), 1e-30)
        lattice = fine_lattice(situation.search_points_m)
        tumour_m = _likely_tumour_m(lattice, _probability(lattice, situation), situation)
        return float(share) ** (n_clusters(tumour_m, _CLUSTER_GAP_M) + 1)

    def _hidden(self, situation: Situation, prior: BallPrior | None = None) -> HiddenBalls:
        return hidden_balls(
            situation.workspace,
            situation.cone,
            situation.search_points_m,
            situation.surface_distance_m,
            prior or self.balls,
        )


def _heed_failures(score: NDArray[np.float64], situation: Situation) -> None:
    """Lower the scores, in place, of poses near those that the arm failed to reach."""
    for failed in situation.skipped:
        score[situation.workspace.within(failed, _FAILURE_RADIUS_M)] *= _AFTER_FAILURE


def _prediction(situation: Situation) -> Prediction:
    if situation.prediction is None:
        raise PlannerError("find-and-outline needs the map's prediction at the search points; got None")
    return situation.prediction


def _probability(lattice: FineLattice, situation: Situation) -> NDArray[np.float64]:
    return probability_at(lattice, _prediction(situation))


def _likely_m3(situation: Situation) -> float:
    """Volume where the map takes tumour to be likelier than not [m^3]."""
    lattice = fine_lattice(situation.search_points_m)
    share = float(np.mean(_prediction(situation).score > 0.0))
    return share * lattice.cell_m3 * len(lattice.points_m)


def _likely_tumour_m(
    lattice: FineLattice, probability: NDArray[np.float64], situation: Situation
) -> NDArray[np.float64]:
    """Where tumour is likely [m], shape (P, 3): by the map, or by labels that can be believed.

    The map smooths over a few labels of tumour among many of none, such as a cone that grazes one returns.
    """
    rate = situation.false_positive_rate
    believed_m = [reading.believed_tumour_m(rate) for reading in situation.readings]
    return np.concatenate([lattice.points_m[probability > 0.5], *believed_m])

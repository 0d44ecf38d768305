"""Find, then outline: search where most could still hide, and cover what was found to its edge."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from .errors import PlannerError
from .fine_lattice import fine_lattice
from .frontier import probability_at, seen_weight, sensed_points
from .hidden_balls import BallPrior, hidden_balls
from .planner import Planner
from .situation import Situation


@dataclass(frozen=True, kw_only=True)
class FindAndOutline(Planner):
    """Two jobs: outlines whatever was found and not yet covered, and searches when nothing is left to outline."""

    needs_belief: ClassVar[bool] = True
    preferred_map: ClassVar[str] = "calibrated"

    margin_m: float = 0.007
    """Unsensed places within this distance of likely tumour may belong to it [m]."""
    floor: float = 0.15
    """Least probability granted to such a place: the map's edges are not sharp enough to deny it."""
    least_gain_m3: float = 5e-8
    """Expected tumour volume that a pose has to add to be worth an outlining action [m^3]."""
    fading: float = 0.03
    """What a ball still counts each time that it was looked at and nothing was found."""
    balls: BallPrior = field(default_factory=BallPrior)
    """What the search takes for possible."""

    def rank(self, situation: Situation) -> Iterator[int]:
        """The poses that outline most, if any outlines enough, then those that find most of what could hide."""
        is_left = situation.available(exclude_sensed=True)
        search = self.search_score(situation)
        score = search
        if situation.sensed:
            outline = self.outline_score(situation)
            if np.max(outline, where=is_left, initial=0.0) >= self.least_gain_m3:
                score = outline / outline.max() + 1e-3 * search / max(search.max(), 1e-30)
        score = np.where(is_left, score, -np.inf)
        order = np.argsort(-score, kind="stable")
        yield from order[: int(is_left.sum())].tolist()

    def search_score(self, situation: Situation) -> NDArray[np.float64]:
        """Share of what could still hide that each pose would find, shape (N,)."""
        balls = hidden_balls(
            situation.workspace,
            situation.cone,
            situation.search_points_m,
            situation.surface_distance_m,
            self.balls,
        )
        left = balls.weights * self.fading ** balls.times_found(situation.sensed)
        return balls.newly_found(left.astype(np.float32)).astype(np.float64)

    def outline_score(self, situation: Situation) -> NDArray[np.float64]:
        """Tumour volume beside what was found that each pose would newly see [m^3], expected, shape (N,)."""
        if situation.prediction is None:
            raise PlannerError("find-and-outline needs the map's prediction at the search points; got None")
        workspace, cone = situation.workspace, situation.cone
        lattice = fine_lattice(situation.search_points_m)
        probability = probability_at(lattice, situation.prediction)
        is_likely = probability > 0.5
        believed_m = [reading.believed_tumour_m(situation.false_positive_rate) for reading in situation.readings]
        tumour_m = np.concatenate([lattice.points_m[is_likely], *believed_m])
        around = lattice.near(tumour_m, self.margin_m)
        points_m = lattice.points_m[around]
        is_open = ~sensed_points(workspace, cone, situation.sensed, points_m)
        weights = np.maximum(probability[around], self.floor)[is_open]
        return lattice.cell_m3 * seen_weight(workspace, cone, points_m[is_open], weights)

"""The paper's planner: the point of highest expected improvement, then a pose that points at it.

It is Algorithm 2 (NextQuery) of Cho, Hermans and Kuntz (2021), with the random first pose of line 6 of Algorithm 1:

    a_t = argmax over x of EI(x)                      (Algorithm 2, line 1: `ExpectedImprovement.score`)
    s_t = next_sensing_pose(a_t, S)                   (Algorithm 2, line 2: `QueryPointPlanner.poses_towards`)

What the paper leaves open is an option here; the defaults are the choices under which every episode found its tumour.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import Prediction

from .acquisition import log_expected_improvement
from .errors import PlannerError
from .query_points import QueryPointPlanner
from .situation import Situation


@dataclass(frozen=True, kw_only=True)
class ExpectedImprovement(QueryPointPlanner):
    """The paper's planner: expected improvement over the search points (eq. 2), then a pose that looks at the best."""

    xi: float = 0.01
    """Margin by which the incumbent has to be exceeded, in the unit of the values (the paper's 0.01)."""

    def __post_init__(self) -> None:
        """Checks names and ranges."""
        super().__post_init__()
        if not 0.0 <= self.xi < math.inf:
            raise PlannerError(f"`xi` must be 0 or above and finite, got {self.xi}")

    def acquisition(self, situation: Situation) -> NDArray[np.float64]:
        """The logarithm of the expected improvement at each search point; see `QueryPointPlanner.acquisition`."""
        return self.score(situation.belief("expected improvement"))

    def score(self, prediction: Prediction) -> NDArray[np.float64]:
        """The logarithm of the expected improvement (eq. 2) at each search point, shape (M,).

        The incumbent f+ is the highest mean of all search points, "the highest value of the distribution".

        Args:
            prediction: The belief at the search points.
        """
        mean, variance = self.moments(prediction)
        return log_expected_improvement(mean, variance, incumbent=float(np.max(mean)), xi=self.xi)

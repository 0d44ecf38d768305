"""The paper's planner: the point of highest expected improvement, then a pose that points at it.

It is Algorithm 2 (NextQuery) of Cho, Hermans and Kuntz (2021), with the random first pose of line 6 of Algorithm 1:

    a_t = argmax over x of EI(x)                      (Algorithm 2, line 1: `ExpectedImprovement.score`)
    s_t = next_sensing_pose(a_t, S)                   (Algorithm 2, line 2: `QueryPointPlanner.poses_towards`)

What the paper leaves open is an option here; the defaults are the choices under which every episode found its tumour.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import Prediction

from .acquisition import log_expected_improvement
from .query_points import IncumbentPlanner
from .situation import Situation


@dataclass(frozen=True, kw_only=True)
class ExpectedImprovement(IncumbentPlanner):
    """The paper's planner: expected improvement over the search points (eq. 2), then a pose that looks at the best."""

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

"""Acquisition functions of points in place of expected improvement, in the paper's Algorithm 2."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..acquisition import log_probability_of_improvement, upper_confidence_bound
from ..errors import PlannerError
from ..query_points import IncumbentPlanner, QueryPointPlanner
from ..situation import Situation


@dataclass(frozen=True, kw_only=True)
class UpperConfidenceBound(QueryPointPlanner):
    """The point of highest mu + beta sigma (Srinivas et al., 2010), then a pose that looks at it."""

    beta: float = 2.0
    """How many deviations count. Their theory lets it grow with the logarithm of the actions; practice keeps it."""

    def __post_init__(self) -> None:
        """Checks names and ranges."""
        super().__post_init__()
        if not 0.0 <= self.beta < math.inf:
            raise PlannerError(f"`beta` must be 0 or above and finite, got {self.beta}")

    def acquisition(self, situation: Situation) -> NDArray[np.float64]:
        """The bound mu + beta sigma at each search point; see `QueryPointPlanner.acquisition`."""
        mean, variance = self.moments(situation.belief("the upper confidence bound"))
        return upper_confidence_bound(mean, variance, beta=self.beta)


@dataclass(frozen=True, kw_only=True)
class ProbabilityOfImprovement(IncumbentPlanner):
    """The point that most likely exceeds the highest mean by xi (Kushner, 1964), then a pose that looks at it."""

    def acquisition(self, situation: Situation) -> NDArray[np.float64]:
        """The logarithm of the probability at each search point; see `QueryPointPlanner.acquisition`."""
        mean, variance = self.moments(situation.belief("the probability of improvement"))
        return log_probability_of_improvement(mean, variance, incumbent=float(np.max(mean)), xi=self.xi)


@dataclass(frozen=True, kw_only=True)
class ThompsonSampling(QueryPointPlanner):
    """The highest point of one map drawn from the belief (Thompson, 1933), then a pose that looks at it.

    `values` makes no difference here: the sigmoid keeps the order.
    """

    def acquisition(self, situation: Situation) -> NDArray[np.float64]:
        """A map drawn jointly from the belief, at each search point; see `QueryPointPlanner.acquisition`."""
        if situation.draw_map is None:
            raise PlannerError(
                "Thompson sampling draws whole maps, and this map cannot: it has no carry_samples and sample_lattice"
            )
        return situation.draw_map(situation.rng)

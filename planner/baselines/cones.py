"""Baselines that look at all that a pose's cone holds, each a sum of weights over the search points in the cone.

score(pose) = v sum over search points x in the pose's cone of  weight(x),   v the volume of a cell
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..acquisition import mutual_information
from ..planner import Planner
from ..situation import Situation
from .sight import sight_of


@dataclass(frozen=True, kw_only=True)
class ConePlanner(Planner):
    """The pose whose cone holds the largest sum of weights; those of equal sums in the workspace's order."""

    @abstractmethod
    def weights(self, situation: Situation, is_sensed: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The weight of each search point, shape (M,), 0 or above.

        Args:
            situation: What is known so far.
            is_sensed: Which search points lay in the cone of a sensed pose, shape (M,).

        Raises:
            PlannerError: If a belief is needed and there is none.
        """

    def score(self, situation: Situation) -> NDArray[np.float64]:
        """The sum of the weights in each pose's cone, shape (N,), in their unit and without the volume of a cell.

        Args:
            situation: What is known so far.
        """
        sight = sight_of(situation.workspace, situation.cone, situation.search_points_m)
        return sight.sums(self.weights(situation, sight.held_by(situation.sensed)))

    def rank(self, situation: Situation) -> Iterator[int]:
        """The poses neither sensed nor skipped, those with the largest sums first; see `Planner.rank`."""
        poses = np.flatnonzero(situation.available(exclude_sensed=True))
        if len(poses):
            yield from poses[np.argsort(-self.score(situation)[poses], kind="stable")].tolist()


@dataclass(frozen=True, kw_only=True)
class MutualInformation(ConePlanner):
    """The pose whose labels are expected to tell most about the map (BALD; Houlsby et al., 2011), point by point.

    weight(x) = I(y; f(x)), which counts a cone's points as if they told independently of each other.
    """

    needs_belief: ClassVar[bool] = True

    def weights(self, situation: Situation, is_sensed: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The mutual information of label and latent at each search point [nat]; see `ConePlanner.weights`."""
        prediction = situation.belief("mutual information")
        return mutual_information(prediction.latent_mean, prediction.latent_variance)


@dataclass(frozen=True, kw_only=True)
class ExpectedVolume(ConePlanner):
    """The pose whose cone is expected to hold most tumour that no cone has held: weight(x) = p(x), 0 where sensed."""

    needs_belief: ClassVar[bool] = True

    def weights(self, situation: Situation, is_sensed: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The probability of tumour at each search point that no cone has held; see `ConePlanner.weights`."""
        return np.where(is_sensed, 0.0, situation.belief("expected volume").probability)


@dataclass(frozen=True, kw_only=True)
class GreedyCoverage(ConePlanner):
    """The pose whose cone holds most of what no cone has held: weight(x) = 1, 0 where sensed. It needs no map.

    After n actions it has covered at least 1 - 1/e of what the best n poses would (Nemhauser, Wolsey and Fisher, 1978).
    """

    needs_belief: ClassVar[bool] = False

    def weights(self, situation: Situation, is_sensed: NDArray[np.bool_]) -> NDArray[np.float64]:
        """One for each search point that no cone has held; see `ConePlanner.weights`."""
        return np.where(is_sensed, 0.0, 1.0)

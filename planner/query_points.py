"""Planners that choose a point and then a pose that looks at it: Algorithm 2 with any acquisition function.

a_t = argmax over x of score(x)                   (Algorithm 2, line 1: `QueryPointPlanner.acquisition`)
s_t = next_sensing_pose(a_t, S)                   (Algorithm 2, line 2: `QueryPointPlanner.poses_towards`)
"""

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from mapping import Prediction

from .acquisition import probability_variance
from .errors import PlannerError
from .planner import Planner
from .random_order import random_order
from .situation import Situation

Values = Literal["latent", "probability"]
PoseRule = Literal["best-aligned", "first-within-threshold"]


@dataclass(frozen=True, kw_only=True)
class QueryPointPlanner(Planner):
    """Algorithm 2 (NextQuery) of Cho, Hermans and Kuntz (2021), whose acquisition function a derived class gives."""

    needs_belief: ClassVar[bool] = True
    preferred_map: ClassVar[Literal["paper", "calibrated"]] = "paper"

    values: Values = "latent"
    """Whose mean and deviation the acquisition function takes: the latent's, or the probability's. The paper's f is
    "the occupancy likelihood distribution", which may mean either. The probability finds several tumours sooner but
    leaves the edge of one that it knows: its incumbent nears 1, which nothing exceeds."""
    pose_rule: PoseRule = "best-aligned"
    """Which pose looks at a query point; `poses_towards` has the formula. The paper's `first-within-threshold` is the
    first pose of the workspace whose normal points at it within a threshold. The default, `best-aligned`, is the pose
    whose normal points at it most nearly, of those whose cone holds it."""
    threshold_rad: float = math.radians(5.0)
    """Largest angle between normal and query vector [rad], for `first-within-threshold`; the paper gives no value."""
    exclude_sensed: bool = True
    """Whether a pose is sensed at most once. The paper does not say so, but the planner might return to one pose for
    ever."""
    exclusion_share: float = 0.28
    """Where sensed poses are excluded, those nearer to one than this share of the radius of the cone's base are ranked
    last: 6 mm under the cone of the scenario `sphere`. The paper's poses are 1.5 mm apart, so that a sensed pose's
    neighbour sees the same again. At a tumour the radius lets the poses spread to its edge, and leave it when it is
    covered."""

    def __post_init__(self) -> None:
        """Checks names and ranges."""
        for name, kind in (("values", Values), ("pose_rule", PoseRule)):
            if getattr(self, name) not in get_args(kind):
                raise PlannerError(
                    f"`{name}` must be one of {', '.join(get_args(kind))}; got {getattr(self, name)!r}"
                )
        if not 0.0 < self.threshold_rad <= math.pi:
            raise PlannerError(f"`threshold_rad` must lie between 0 and pi, got {self.threshold_rad}")
        if not 0.0 <= self.exclusion_share < math.inf:
            raise PlannerError(f"`exclusion_share` must be 0 or above, got {self.exclusion_share}")

    @abstractmethod
    def acquisition(self, situation: Situation) -> NDArray[np.float64]:
        """The acquisition function at each search point, or what orders the points alike, shape (M,).

        Args:
            situation: What is known so far, at least one reading among it.

        Raises:
            PlannerError: If the function needs what the situation does not hold.
        """

    def rank(self, situation: Situation) -> Iterator[int]:
        """The poses that look at the best query point, then those that look at the next best, and so on (Algorithm 2).

        Before the first reading nothing is known, so the order is random (Algorithm 1, line 6). Where no pose qualifies
        for a query point, the next best is taken: organs have places that no pose sees, and these keep the highest
        deviation for ever. See `Planner.rank`.
        """
        if not situation.sensed:
            return random_order(situation)
        return self._rank_by_query_point(situation, self.acquisition(situation))

    def moments(self, prediction: Prediction) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The mean and the variance of the values at each search point, each of shape (M,).

        Args:
            prediction: The belief at the search points.
        """
        if self.values == "latent":
            return prediction.latent_mean, prediction.latent_variance
        variance = probability_variance(prediction.latent_mean, prediction.latent_variance)
        return prediction.probability, variance

    def poses_towards(
        self, point_m: NDArray[np.float64], situation: Situation, is_available: NDArray[np.bool_]
    ) -> NDArray[np.intp]:
        """The poses that qualify for a query point, in the rule's order; empty where none does.

        A pose at p with inward normal o looks at the query point a along q = a - p, off its normal by

            angle = arccos(o . q / |q|)   (section IV-C; `Workspace.angles_to_rad`).

        `first-within-threshold`, the paper's rule, takes the poses whose angle is at most the threshold, in the
        workspace's order. `best-aligned` takes those whose cone holds a, the least angle first: under the paper's rule
        the cone points at a but may end above it, and then does not sense it.

        Args:
            point_m: The query point a [m, world], shape (3,).
            situation: What is known so far.
            is_available: Which poses may be taken, shape (N,).
        """
        workspace = situation.workspace
        angles_rad = workspace.angles_to_rad(point_m)
        if self.pose_rule == "first-within-threshold":
            return np.flatnonzero(is_available & (angles_rad <= self.threshold_rad))
        sees = situation.cone.contains(point_m, workspace.positions_m, workspace.normals)
        poses = np.flatnonzero(is_available & sees)
        return poses[np.argsort(angles_rad[poses], kind="stable")]

    def _rank_by_query_point(self, situation: Situation, score: NDArray[np.float64]) -> Iterator[int]:
        is_left = situation.available(exclude_sensed=self.exclude_sensed)
        is_available = is_left & ~self._near_sensed(situation)
        for query in np.argsort(-score, kind="stable"):
            if not is_available.any():
                break
            # This spares the search for a pose that is not there.
            if situation.is_visible is not None and not situation.is_visible[query]:
                continue
            poses = self.poses_towards(situation.search_points_m[query], situation, is_available)
            is_available[poses] = is_left[poses] = False
            yield from poses.tolist()
        yield from np.flatnonzero(is_left).tolist()

    def _near_sensed(self, situation: Situation) -> NDArray[np.bool_]:
        """Which poses are nearer to a sensed one than the exclusion radius, shape (N,); none where poses may return."""
        positions_m = situation.workspace.positions_m
        if not self.exclude_sensed:
            return np.zeros(len(positions_m), dtype=np.bool_)
        radius_m = self.exclusion_share * situation.cone.base_radius_m
        squared_m2 = cdist(positions_m[list(situation.sensed)], positions_m, "sqeuclidean")
        return np.min(squared_m2, axis=0, initial=np.inf) < radius_m**2


@dataclass(frozen=True, kw_only=True)
class IncumbentPlanner(QueryPointPlanner):
    """A planner whose acquisition function asks about an improvement over the best value so far, the incumbent f+."""

    xi: float = 0.01
    """Margin by which the incumbent has to be exceeded, in the unit of the values (the paper's 0.01)."""

    def __post_init__(self) -> None:
        """Checks names and ranges."""
        super().__post_init__()
        if not 0.0 <= self.xi < math.inf:
            raise PlannerError(f"`xi` must be 0 or above and finite, got {self.xi}")

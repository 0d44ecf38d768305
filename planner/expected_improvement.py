"""The paper's planner: the point of highest expected improvement, then a pose that points at it.

Algorithms 1 and 2 of Cho, Hermans and Kuntz (2021). What the paper leaves open is an option here; the
defaults are the readings under which every trial found its tumour.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from mapping import Prediction

from .acquisition import log_expected_improvement, probability_variance
from .errors import PlannerError
from .planner import Planner
from .random_order import random_order
from .situation import Situation

Values = Literal["latent", "probability"]
PoseRule = Literal["best-aligned", "first-within-threshold"]


@dataclass(frozen=True, kw_only=True)
class ExpectedImprovement(Planner):
    """Expected improvement over the search points (eq. 2), then the pose that looks at the best of them."""

    needs_belief: ClassVar[bool] = True
    preferred_map: ClassVar[Literal["paper", "calibrated"]] = "paper"

    values: Values = "latent"
    """Whose mean and deviation enter: the latent's, or the probability's. The probability finds several
    tumours sooner but leaves the edge of one that it knows: its incumbent nears 1, which nothing exceeds."""
    pose_rule: PoseRule = "best-aligned"
    """`best-aligned`: of the poses whose cone holds the query point, that with the least angle between normal
    and query vector. `first-within-threshold`: the first pose of the workspace whose angle is at most the
    threshold, as the paper has it. Where no pose qualifies, both go on to the next query point: organs have
    places that no pose sees, and these keep the highest deviation for ever."""
    threshold_rad: float = math.radians(5.0)
    """Largest angle between normal and query vector [rad], for `first-within-threshold`."""
    exclude_sensed: bool = True
    """Whether a pose is sensed once at most. Without it the planner may return to one pose for ever."""
    exclusion_share: float = 0.28
    """Poses nearer to a sensed one than this share of the radius of the cone's base are ranked last, when poses
    are excluded: 6 mm under the paper's cone. The paper's poses are 1.5 mm apart, so a sensed pose's neighbour
    sees the same again; at a tumour the radius lets the poses spread to its edge, and leave it when it is
    covered."""
    xi: float = 0.01
    """Margin by which the incumbent has to be exceeded, in the unit of the values (the paper's 0.01)."""

    def __post_init__(self) -> None:
        """Check names and ranges."""
        for name, kind in (("values", Values), ("pose_rule", PoseRule)):
            if getattr(self, name) not in get_args(kind):
                raise PlannerError(
                    f"{name} must be one of {', '.join(get_args(kind))}; got {getattr(self, name)!r}"
                )
        if not 0.0 < self.threshold_rad <= math.pi:
            raise PlannerError(f"threshold_rad must lie between 0 and pi, got {self.threshold_rad}")
        if not 0.0 <= self.exclusion_share < math.inf:
            raise PlannerError(f"exclusion_share must be 0 or above, got {self.exclusion_share}")
        if not 0.0 <= self.xi < math.inf:
            raise PlannerError(f"xi must be 0 or above and finite, got {self.xi}")

    def rank(self, situation: Situation) -> Iterator[int]:
        """The poses that look at the best query point, then those that look at the next best, and so on.

        Before the first reading nothing is known, so the order is random (Algorithm 1, line 6).
        """
        if not situation.sensed:
            return random_order(situation)
        if situation.prediction is None:
            raise PlannerError(
                "expected improvement needs the map's prediction at the search points; got None"
            )
        return self._rank_by_query_point(situation, self.score(situation.prediction))

    def score(self, prediction: Prediction) -> NDArray[np.float64]:
        """Logarithm of the expected improvement over the highest mean, at each search point, shape (M,).

        Args:
            prediction: The belief at the search points.
        """
        if self.values == "latent":
            mean, variance = prediction.latent_mean, prediction.latent_variance
        else:
            mean = prediction.probability
            variance = probability_variance(prediction.latent_mean, prediction.latent_variance)
        return log_expected_improvement(mean, variance, incumbent=float(np.max(mean)), xi=self.xi)

    def _rank_by_query_point(self, situation: Situation, score: NDArray[np.float64]) -> Iterator[int]:
        is_left = situation.available(exclude_sensed=self.exclude_sensed)
        is_available = is_left & ~self._near_sensed(situation)
        for query in np.argsort(-score, kind="stable"):
            if not is_available.any():
                break
            if situation.is_visible is not None and not situation.is_visible[query]:
                continue  # spares the search for a pose that is not there
            poses = self._poses_towards(situation.search_points_m[query], situation, is_available)
            is_available[poses] = is_left[poses] = False
            yield from poses.tolist()
        yield from np.flatnonzero(is_left).tolist()

    def _near_sensed(self, situation: Situation) -> NDArray[np.bool_]:
        """Which poses are nearer to a sensed one than the radius, shape (N,); none if they may return."""
        positions_m = situation.workspace.positions_m
        if not self.exclude_sensed:
            return np.zeros(len(positions_m), dtype=np.bool_)
        radius_m = self.exclusion_share * situation.cone.base_radius_m
        squared_m2 = cdist(positions_m[list(situation.sensed)], positions_m, "sqeuclidean")
        return np.min(squared_m2, axis=0, initial=np.inf) < radius_m**2

    def _poses_towards(
        self, point_m: NDArray[np.float64], situation: Situation, is_available: NDArray[np.bool_]
    ) -> NDArray[np.intp]:
        """The poses that qualify for a query point, in the rule's order; none if there is none."""
        workspace = situation.workspace
        angles_rad = workspace.angles_to_rad(point_m)
        if self.pose_rule == "first-within-threshold":
            return np.flatnonzero(is_available & (angles_rad <= self.threshold_rad))
        sees = situation.cone.contains(point_m, workspace.positions_m, workspace.normals)
        poses = np.flatnonzero(is_available & sees)
        return poses[np.argsort(angles_rad[poses], kind="stable")]

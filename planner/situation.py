"""What a planner may know when it ranks the poses; the truth is not part of it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping import LabelledPoints, Prediction

from .cone import Cone
from .errors import PlannerError
from .paths.roadmap import Roadmap
from .workspace import Workspace

_TIP_SPEED_M_S = 0.25
"""Speed of the tip of a probe of whose motion nothing is known [m/s]."""


@dataclass(frozen=True, eq=False)
class PlaceBelief:
    """What is believed of how far the organ lies from where it is taken to lie."""

    deviation_m: float
    """How far points of the organ are believed to be off, a root mean square [m]."""
    contact_gains_m2: Callable[[], NDArray[np.float64]]
    """By how much one contact at each pose is expected to lower the square of that [m^2], shape (N,) for N poses."""
    register_above_m: float = np.inf
    """How far off they have to be for an action to be spent on registering [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Situation:
    """The state of an episode between two sensing actions, as a planner sees it."""

    workspace: Workspace
    """All sensing poses."""
    cone: Cone
    """The volume that one sensing action sees."""
    search_points_m: NDArray[np.float64]
    """The search space: lattice points inside the organ [m, world], shape (M, 3)."""
    prediction: Prediction | None
    """The belief at the search points, arrays of shape (M,); None if the planner needs no belief."""
    sensed: tuple[int, ...] = ()
    """Indices of the poses sensed so far, in order."""
    skipped: frozenset[int] = frozenset()
    """Indices of the poses that the arm failed to reach."""
    is_visible: NDArray[np.bool_] | None = None
    """Which search points some pose sees, from `visible_points`, shape (M,); None if that is not known."""
    surface_distance_m: NDArray[np.float64] | None = None
    """Distance of each search point to the organ's surface [m], shape (M,); None if that is not known."""
    readings: tuple[LabelledPoints, ...] = ()
    """What each sensing action returned, in order."""
    false_positive_rate: float = 0.0
    """Share of free points that the sensor is believed to call tumour."""
    false_negative_rate: float = 0.0
    """Share of tumour points that the sensor is believed to call free."""
    missed_rate: float = 0.0
    """Chance with which a view is believed to miss a lesion as a whole."""
    motion_s: Callable[[NDArray[np.intp]], NDArray[np.float64]] | None = None
    """Modelled time of the transfer from above the last pose to above others [s], infinite for those that the arm does
    not reach; None where nobody can say, as before the first action."""
    miss_cost: float | None = None
    """How many sensing actions a missed lesion is worth; None where nobody says."""
    until_confident: float | None = None
    """The confidence that nothing is left at which the episode is to stop; None where it does not stop by that."""
    sensing_s: float = 2.0
    """Modelled time of one sensing action [s]."""
    roadmap: Roadmap | None = None
    """Where the probe glides from pose to pose, reading on the way; None where it is lifted after each reading."""
    sweep_speed_m_s: float = 0.04
    """Speed of the tip on the roadmap [m/s]."""
    read_every_m: float = 0.01
    """Way of the tip on the roadmap from one reading to the next [m]."""
    draw_map: Callable[[np.random.Generator], NDArray[np.float64]] | None = None
    """Draws the latent at all search points jointly from the belief, shape (M,); None where the map cannot."""
    place: PlaceBelief | None = None
    """What is believed of where the organ lies; None where it lies as planned, or nothing tells."""
    rng: np.random.Generator
    """The planner's own stream of randomness."""

    def __post_init__(self) -> None:
        """Checks shapes and indices.

        Raises:
            PlannerError: If an array does not fit the search points, or an index is no pose of the workspace.
        """
        points = self.search_points_m
        if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
            raise PlannerError(
                f"search_points_m must have shape (M, 3) with M of at least 1, got {points.shape}"
            )
        if self.prediction is not None and self.prediction.latent_mean.shape != (len(points),):
            raise PlannerError(
                f"the prediction has shape {self.prediction.latent_mean.shape}, but there are {len(points)} "
                "search points: predict at exactly these points"
            )
        if self.is_visible is not None and self.is_visible.shape != (len(points),):
            raise PlannerError(
                f"is_visible has shape {self.is_visible.shape}, not one value per search point"
            )
        if self.surface_distance_m is not None and self.surface_distance_m.shape != (len(points),):
            raise PlannerError(
                f"surface_distance_m has shape {self.surface_distance_m.shape}, not one value per search point"
            )
        object.__setattr__(self, "skipped", frozenset(self.skipped))
        self._check_indices("sensed", self.sensed)
        self._check_indices("skipped", self.skipped)

    def belief(self, planner: str) -> Prediction:
        """The belief at the search points.

        Args:
            planner: What needs it, for the error.

        Raises:
            PlannerError: If there is none.
        """
        if self.prediction is None:
            raise PlannerError(
                f"{planner} needs the map's prediction at the search points, but there is none"
            )
        return self.prediction

    def available(self, *, exclude_sensed: bool) -> NDArray[np.bool_]:
        """Which poses may be proposed, shape (N,): all but those that the arm failed to reach.

        Args:
            exclude_sensed: Whether the poses sensed before are left out too.
        """
        is_available = np.ones(self.workspace.n_poses, dtype=np.bool_)
        is_available[list(self.skipped)] = False
        if exclude_sensed:
            is_available[list(self.sensed)] = False
        return is_available

    def seconds_to(self, poses: NDArray[np.intp]) -> NDArray[np.float64]:
        """The time of the transfer to each pose [s], shape (k,); without a model, the tip's way at 0.25 m/s.

        Args:
            poses: Indices of poses, shape (k,).
        """
        if self.motion_s is not None:
            return self.motion_s(poses)
        if not self.sensed:
            return np.zeros(len(poses))
        last_m = self.workspace.positions_m[self.sensed[-1]]
        return np.linalg.norm(self.workspace.positions_m[poses] - last_m, axis=1) / _TIP_SPEED_M_S

    def _check_indices(self, name: str, indices: Iterable[int]) -> None:
        n_poses = self.workspace.n_poses
        wrong = [index for index in indices if not 0 <= index < n_poses]
        if wrong:
            raise PlannerError(
                f"{name} holds pose {wrong[0]}, but the workspace's poses are 0 .. {n_poses - 1}"
            )

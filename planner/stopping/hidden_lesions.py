"""Lesions that could hide: balls of the prior's sizes, even in place, also where no pose can find them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..cone import Cone
from ..find_and_outline.hidden_balls import HiddenBalls, distance_to_cones, point_spacing_m, poses_that_find
from ..keyed_array import KeyedArray
from ..situation import Situation
from ..workspace import Workspace
from .lesion_prior import LesionPrior

N_LESIONS = 2000
"""Number of balls that stand for what could hide."""
_N_PLACES, _SHRINKING, _N_SIZES = 20, 5.0 / 6.0, 20
"""A lesion that fits at none of so many places is made smaller by a sixth, as planted ones are, so many times."""
_DEPTH_SHARE = 0.5
"""A pose can find a lesion where its cone reaches this share of the radius or more into it."""


@dataclass(frozen=True, eq=False)
class HiddenLesions:
    """Balls that are equally likely to be a lesion, and which poses could find them."""

    balls: HiddenBalls
    """The B balls of equal weight; a pose finds one that its cone reaches deep enough into."""

    def can_be_found(self, is_available: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Which lesions some pose can find, shape (B,).

        Args:
            is_available: Which poses can be taken, shape (N,).
        """
        return np.asarray(self.balls.finds.T @ is_available.astype(np.float32) > 0.0)

    def chance_of_missing(
        self, workspace: Workspace, cone: Cone, poses: list[int], labels_per_m3: float
    ) -> NDArray[np.float64]:
        """The probability that a reading at a pose has no label in a lesion, shape (poses, B).

            exp(-rho v f),   v the lesion's volume,   f = (1 - x)^2 (2 + x) / 4,   x = distance to the cone / radius

        f is the share of the ball within the cone, whose nearest face is taken to be flat; labels are taken to lie as
        if by chance, rho in a volume.

        Args:
            workspace: The N poses.
            cone: What one of them sees.
            poses: Indices of poses.
            labels_per_m3: Labels of a reading in a volume that call tumour what is tumour, rho [1/m^3].
        """
        radii_m = self.balls.radii_m[:, None]
        gap_m = distance_to_cones(workspace.part(poses), cone, self.balls.centres_m)
        x = np.clip(gap_m / radii_m, -1.0, 1.0)
        share = (1.0 - x) ** 2 * (2.0 + x) / 4.0
        return np.exp(-labels_per_m3 * 4.0 / 3.0 * np.pi * radii_m**3 * share).T


def hidden_lesions(situation: Situation, prior: LesionPrior) -> HiddenLesions:
    """The lesions that could be in the organ; they are kept, and returned again for the same arrays.

    Args:
        situation: Gives poses, cone, organ and the distance to its surface; without that, lesions may protrude.
        prior: Their sizes.
    """
    distance_m = situation.surface_distance_m
    return _hidden_lesions(
        situation.workspace,
        situation.cone,
        KeyedArray(situation.search_points_m),
        None if distance_m is None else KeyedArray(distance_m),
        prior,
    )


@lru_cache(maxsize=2)
def _hidden_lesions(
    workspace: Workspace, cone: Cone, points: KeyedArray, distance: KeyedArray | None, prior: LesionPrior
) -> HiddenLesions:
    radii_m = np.random.default_rng(0).permutation(prior.diameters_m(N_LESIONS) / 2.0)
    centres_m, radii_m = _placed(points.array, None if distance is None else distance.array, radii_m)
    finds = poses_that_find(workspace, cone, centres_m, (1.0 - _DEPTH_SHARE) * radii_m)
    weights = np.full(len(radii_m), 1.0 / len(radii_m), dtype=np.float32)
    return HiddenLesions(HiddenBalls(centres_m, radii_m, weights, finds))


def _placed(
    points_m: NDArray[np.float64], distance_m: NDArray[np.float64] | None, radii_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres of balls, even in the places where each fits, from a Halton sequence, and their radii."""
    # Loaded here, since it loads slowly and only stops by cost need it.
    from scipy.stats import qmc

    tree = KDTree(points_m)
    low_m, high_m = points_m.min(axis=0), points_m.max(axis=0)
    spacing_m = point_spacing_m(tree)
    sequence = qmc.Halton(3, rng=np.random.default_rng(0))
    centres_m, radii_m, left = np.empty((len(radii_m), 3)), radii_m.copy(), np.arange(len(radii_m))
    for number in range(1, _N_PLACES * _N_SIZES + 1):
        if not len(left):
            break
        place_m = low_m + sequence.random(len(left)) * (high_m - low_m)
        gap_m, nearest = tree.query(place_m)
        fits = gap_m <= spacing_m
        if distance_m is not None:
            fits &= distance_m[nearest] >= radii_m[left]
        centres_m[left[fits]] = place_m[fits]
        left = left[~fits]
        if number % _N_PLACES == 0:
            radii_m[left] *= _SHRINKING
    return np.delete(centres_m, left, axis=0), np.delete(radii_m, left)

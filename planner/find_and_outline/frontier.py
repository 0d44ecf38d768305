"""The frontier of what was found: unsensed places in and beside likely tumour, and what each pose sees of them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import expit

from mapping import Prediction

from ..cone import Cone
from ..situation import Situation
from ..visibility import visibility
from ..workspace import Workspace
from .fine_lattice import FineLattice
from .hidden_balls import distance_to_cones

_SUSPECTED, _CONFIRMED = 0.2, 0.9
"""Where views may be wrong, a place of the first probability is a suspect, and one of the second is confirmed."""
_ENOUGH_LOOKS = 3
"""A suspect that lay in this many cones is looked at no more for its own sake."""
_CUBE_M = 0.03
"""Points are handled cube by cube of this side [m], so that most poses drop out at once."""


@lru_cache(maxsize=2)
def probability_at(lattice: FineLattice, prediction: Prediction) -> NDArray[np.float64]:
    """The probability of tumour at the fine points, shape (F,), from the interpolated score, which is smooth.

    It is kept, since score, confidence and count of one belief ask for it, and cannot be written to.

    Args:
        lattice: The fine points.
        prediction: The belief at the search points.
    """
    probability = expit(lattice.interpolate(prediction.score))
    probability.flags.writeable = False
    return probability


def likely_tumour_m(
    lattice: FineLattice, probability: NDArray[np.float64], situation: Situation
) -> NDArray[np.float64]:
    """The places where tumour is likely [m], shape (P, 3): by the map, or by labels that can be believed.

    The map smooths away a few labels of tumour among many of none, such as a cone that grazes one returns.

    Args:
        lattice: The fine points.
        probability: The probability of tumour at them, shape (F,).
        situation: What is known so far.
    """
    rate = situation.false_positive_rate
    # Where views may invent lesions, the map weighs them against each other.
    believed_m = [reading.believed_tumour_m(rate) for reading in situation.readings if reading.weight is None]
    least = 0.5 if situation.missed_rate == 0.0 else _SUSPECTED
    return np.concatenate([lattice.points_m[probability > least], *believed_m])


def sensed_points(
    workspace: Workspace, cone: Cone, sensed: tuple[int, ...], points_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which points lay in the cone of a sensed pose, shape (F,).

    Args:
        workspace: The N poses.
        cone: What one of them sees.
        sensed: Indices of the poses sensed so far.
        points_m: The points [m, world], shape (F, 3).
    """
    if not sensed or not len(points_m):
        return np.zeros(len(points_m), dtype=bool)
    return np.asarray(visibility(workspace.part(sensed), cone, points_m).any(axis=1))


def unconfirmed_points(
    situation: Situation,
    points_m: NDArray[np.float64],
    probability: NDArray[np.float64],
    margin_m: float,
) -> NDArray[np.bool_]:
    """Which points belong to a finding that more looks would confirm or drop, shape (F,).

    They are suspected to be tumour, lay in fewer than three cones, and no place nearby is confirmed.

    Args:
        situation: What is known so far.
        points_m: The points [m, world], shape (F, 3).
        probability: The probability of tumour there, shape (F,).
        margin_m: What counts as nearby [m].
    """
    is_suspect = probability > _SUSPECTED
    confirmed_m, suspect = points_m[probability > _CONFIRMED], np.flatnonzero(is_suspect)
    if len(confirmed_m) and suspect.size:
        gap_m, _ = KDTree(confirmed_m).query(points_m[suspect], distance_upper_bound=margin_m)
        is_suspect[suspect[np.isfinite(gap_m)]] = False
    suspect = np.flatnonzero(is_suspect)
    if suspect.size:
        sensed = situation.workspace.part(situation.sensed)
        n_looks = visibility(sensed, situation.cone, points_m[suspect]).sum(axis=1)
        is_suspect[suspect[n_looks >= _ENOUGH_LOOKS]] = False
    return is_suspect


def seen_weight(
    workspace: Workspace, cone: Cone, points_m: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The sum of the weights of the points in each pose's cone, shape (N,).

    Args:
        workspace: The N poses.
        cone: What one of them sees.
        points_m: Points [m], shape (F, 3).
        weights: Their weights, shape (F,).
    """
    total = np.zeros(workspace.n_poses)
    if not len(points_m):
        return total
    cubes, cube_of = np.unique(np.floor(points_m / _CUBE_M).astype(int), axis=0, return_inverse=True)
    members = [np.flatnonzero(cube_of.ravel() == cube) for cube in range(len(cubes))]
    middles_m = np.array([(points_m[i].min(axis=0) + points_m[i].max(axis=0)) / 2 for i in members])
    gaps_m = distance_to_cones(workspace, cone, middles_m)
    for inside, middle_m, gap_m in zip(members, middles_m, gaps_m, strict=True):
        radius_m = np.linalg.norm(points_m[inside] - middle_m, axis=1).max()
        poses = np.flatnonzero(gap_m <= radius_m + 1e-6)
        if poses.size:
            total[poses] += weights[inside] @ visibility(workspace.part(poses), cone, points_m[inside])
    return total

"""The frontier of what was found: unsensed places in and beside likely tumour, and what each pose sees of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from mapping import Prediction

from ..cone import Cone
from ..visibility import visibility
from ..workspace import Workspace
from .fine_lattice import FineLattice
from .hidden_balls import distance_to_cones

_CUBE_M = 0.03
"""Points are handled cube by cube of this side [m], so that most poses drop out at once."""


def probability_at(lattice: FineLattice, prediction: Prediction) -> NDArray[np.float64]:
    """The probability of tumour at the fine points, shape (F,), from the interpolated score, which is smooth.

    Args:
        lattice: The fine points.
        prediction: The belief at the search points.
    """
    return expit(lattice.interpolate(prediction.score))


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

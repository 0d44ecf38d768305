"""Balls that could still hide: they stand for what a search has to find, whose size it does not know.

Quasi-random balls, even in place and in the logarithm of the radius, stand for every tumour that fits into the
organ. A pose finds a ball when its cone reaches deep enough into it, so the table of poses and balls is a set system,
and the next pose of a search is the one that finds most of the balls that no pose has found.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

from ..cone import Cone
from ..keyed_array import KeyedArray
from ..workspace import Workspace

_BALLS_AT_ONCE = 128
"""Balls per block of the dense table."""
_BYTES_AT_ONCE = 2**19
"""Size of a part of a block, so that what is computed with it stays in the processor's cache."""
_SPACINGS_TO_A_POINT = 1.0
"""A drawn centre that is farther from all search points than this many of their spacings lies outside the organ."""


@dataclass(frozen=True, kw_only=True)
class BallPrior:
    """Which balls stand for the tumours that could be there."""

    n_balls: int = 3000
    """Number of balls; the error that they make in a share of the organ is below 1 / sqrt(n_balls)."""
    radius_range_m: tuple[float, float] = (0.008, 0.025)
    """Least and largest radius [m], even in the logarithm. Smaller tumours do hide, but a search that minds them finds
    all others later."""
    overlap_share: float = 0.75
    """How deep into a ball a cone has to reach to find it, as a share of the radius."""
    radius_power: float = 2.0
    """A ball's weight is this power of its radius."""


@dataclass(frozen=True, eq=False)
class HiddenBalls:
    """The balls, and which poses find which."""

    centres_m: NDArray[np.float64]
    """Centres [m, world], shape (B, 3)."""
    radii_m: NDArray[np.float64]
    """Radii [m], shape (B,)."""
    weights: NDArray[np.float32]
    """Weight of each ball, shape (B,); they add up to 1."""
    finds: sparse.csr_matrix
    """1 where a pose finds a ball, shape (N, B)."""

    def times_found(self, poses: tuple[int, ...]) -> NDArray[np.float32]:
        """The number of poses, among some, that find each ball, shape (B,)."""
        if not poses:
            return np.zeros(len(self.radii_m), dtype=np.float32)
        return np.asarray(self.finds[list(poses)].sum(axis=0), dtype=np.float32).ravel()

    def newly_found(self, weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """The weight of the balls that each pose finds, shape (N,).

        Args:
            weights: What each ball still weighs, shape (B,).
        """
        return self.finds @ weights


def hidden_balls(
    workspace: Workspace,
    cone: Cone,
    points_m: NDArray[np.float64],
    surface_distance_m: NDArray[np.float64] | None,
    prior: BallPrior,
) -> HiddenBalls:
    """The balls that fit into an organ, with their table; they are kept, and returned again for the same arrays.

    Args:
        workspace: The N poses.
        cone: What one of them sees.
        points_m: The search points [m, world], shape (M, 3).
        surface_distance_m: Their distance to the organ's surface [m], shape (M,); if None, balls may protrude.
        prior: Which balls there could be.
    """
    distance = None if surface_distance_m is None else KeyedArray(surface_distance_m)
    return _hidden_balls(workspace, cone, KeyedArray(points_m), distance, prior)


@lru_cache(maxsize=4)
def _hidden_balls(
    workspace: Workspace, cone: Cone, points: KeyedArray, distance: KeyedArray | None, prior: BallPrior
) -> HiddenBalls:
    centres_m, radii_m = _draw(points.array, None if distance is None else distance.array, prior)
    finds = poses_that_find(workspace, cone, centres_m, radii_m * (1.0 - prior.overlap_share))
    is_findable = np.asarray(finds.sum(axis=0)).ravel() > 0
    centres_m, radii_m = centres_m[is_findable], radii_m[is_findable]
    weights = radii_m**prior.radius_power
    weights = (weights / max(weights.sum(), np.finfo(float).tiny)).astype(np.float32)
    return HiddenBalls(centres_m, radii_m, weights, finds[:, is_findable])


def _draw(
    points_m: NDArray[np.float64], distance_m: NDArray[np.float64] | None, prior: BallPrior
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres and radii of balls inside the organ, from a Halton sequence."""
    # Loaded here, since it loads slowly and only searches need it.
    from scipy.stats import qmc

    tree = KDTree(points_m)
    low_m, high_m = points_m.min(axis=0), points_m.max(axis=0)
    spacing_m = point_spacing_m(tree)
    sequence = qmc.Halton(4, rng=np.random.default_rng(0))
    low, high = np.log(prior.radius_range_m)
    centres, radii, n_kept = [], [], 0
    for _ in range(100):
        draw = sequence.random(2 * prior.n_balls)
        centre_m = low_m + draw[:, :3] * (high_m - low_m)
        radius_m = np.exp(low + draw[:, 3] * (high - low))
        gap_m, nearest = tree.query(centre_m)
        fits = gap_m <= _SPACINGS_TO_A_POINT * spacing_m
        if distance_m is not None:
            fits &= distance_m[nearest] >= radius_m
        centres.append(centre_m[fits])
        radii.append(radius_m[fits])
        n_kept += int(fits.sum())
        if n_kept >= prior.n_balls:
            break
    return np.concatenate(centres)[: prior.n_balls], np.concatenate(radii)[: prior.n_balls]


def point_spacing_m(tree: KDTree) -> float:
    """The median distance between neighbouring search points [m]."""
    if tree.n < 2:
        return 0.0
    some = tree.data[:: max(1, tree.n // 200)]
    return float(np.median(tree.query(some, k=2)[0][:, 1]))


def poses_that_find(
    workspace: Workspace, cone: Cone, centres_m: NDArray[np.float64], reach_m: NDArray[np.float64]
) -> sparse.csr_matrix:
    """1 where a pose's cone comes nearer to a ball's centre than its reach, shape (N, B).

    Args:
        workspace: The N poses.
        cone: What one of them sees.
        centres_m: Centres of the balls [m, world], shape (B, 3).
        reach_m: How near a cone has to come to each [m], shape (B,).
    """
    rows = []
    for start in range(0, len(centres_m), _BALLS_AT_ONCE):
        block = slice(start, start + _BALLS_AT_ONCE)
        gap_m = distance_to_cones(workspace, cone, centres_m[block])
        rows.append(sparse.csr_matrix(gap_m <= reach_m[block, None]))
    if not rows:
        return sparse.csr_matrix((workspace.n_poses, 0), dtype=np.float32)
    return sparse.vstack(rows).T.tocsr().astype(np.float32)


def distance_to_cones(workspace: Workspace, cone: Cone, points_m: NDArray[np.float64]) -> NDArray[np.float32]:
    """The signed distance of points to the cones' faces [m], negative inside, shape (M, N).

    The larger of the distances to mantle and base: exact inside and beside them, too small beyond edge and apex.

    Args:
        workspace: The N poses.
        cone: What one of them sees.
        points_m: Points [m, world], shape (M, 3).
    """
    centre_m = workspace.positions_m.mean(axis=0)
    positions_m = (workspace.positions_m - centre_m).astype(np.float32)
    normals = workspace.normals.astype(np.float32)
    points = (points_m - centre_m).astype(np.float32)
    axial_m = points @ normals.T
    # Newer types of NumPy take a Python number for a double; no copy is made.
    squared = (points @ (-2.0 * positions_m.T)).astype(np.float32, copy=False)
    foot_m = np.einsum("ij,ij->i", positions_m, normals)
    squares = np.einsum("ij,ij->i", points, points)[:, None], np.einsum("ij,ij->i", positions_m, positions_m)
    n_rows = max(1, _BYTES_AT_ONCE // max(axial_m[:1].nbytes, 1))
    for start in range(0, len(points), n_rows):
        rows = slice(start, start + n_rows)
        axial, mantle = axial_m[rows], squared[rows]
        axial -= foot_m
        mantle += squares[0][rows]
        mantle += squares[1]
        mantle -= axial**2
        np.sqrt(np.maximum(mantle, 0.0, out=mantle), out=mantle)
        mantle *= math.cos(cone.half_angle_rad)
        mantle -= math.sin(cone.half_angle_rad) * axial
        axial -= cone.depth_m
        np.maximum(mantle, axial, out=mantle)
    return squared

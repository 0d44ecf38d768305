"""The slide field: a configuration for each pose, so that the arm slides from pose to pose with the probe kept down.

An arm with a free roll and a redundant joint reaches a pose in a family of configurations, of which one is kept for
each pose. The field is grown and not optimised: what one root cannot reach by sliding gets a root, and so a region, of
its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from planner import Workspace

from .damped_least_squares import descend
from .search import IkSearch

N_NEIGHBOURS = 8
"""Nearest poses that count as neighbours: as many as stand around a pose of a grid."""
MAX_GAP = 3.0
"""Neighbours are at most this many times the median spacing away."""
MAX_MOVE_RAD = 0.35
"""A joint that turns (or slides) more than this between neighbours has not merely slid along [rad or m]."""


@dataclass(frozen=True, eq=False)
class SlideField:
    """A configuration for each of N poses, and which poses the arm slides between."""

    q: NDArray[np.float64]
    """Joint positions of the chain [rad or m], shape (N, n); meaningless where no region is."""
    region: NDArray[np.int64]
    """The region of each reached pose, numbered by falling size from 0, and -1 where not reached, shape (N,)."""


def slide_field(
    search: IkSearch,
    workspace: Workspace,
    q: NDArray[np.float64],
    is_reached: NDArray[np.bool_],
    score: NDArray[np.float64],
) -> SlideField:
    """A configuration for each reached pose, continuous over each region of poses.

    A region is grown from the pose of best score. From each pose in it the arm moves on to every neighbour by a small
    step in its joints; a neighbour belongs to the region if that step ends within tolerance, within the limits and
    without a contact. So the region is a tree of moves that the arm can make with the probe kept down.

    Args:
        search: Solves for the arm.
        workspace: The N poses.
        q: Joint positions of the chain at the poses, shape (N, n).
        is_reached: Which poses may be reached, shape (N,).
        score: Score of each pose, shape (N,); regions start at the highest, and none at a pose of minus infinity.
    """
    neighbours = _neighbours(workspace)
    region = np.full(workspace.n_poses, -1, dtype=np.int64)
    carried, n_regions = q.copy(), 0
    for start in np.argsort(-np.where(is_reached, score, -np.inf), kind="stable"):
        if not is_reached[start] or region[start] >= 0 or score[start] == -np.inf:
            continue
        region[start], front = n_regions, [int(start)]
        while front:
            pairs = [(a, int(b)) for a in front for b in neighbours[a] if is_reached[b] and region[b] < 0]
            front = []
            while pairs:
                # One move to each neighbour is tried at a time.
                taken = {b: a for a, b in reversed(pairs)}
                to, origin = (np.array(ends, dtype=np.int64) for ends in (list(taken), list(taken.values())))
                moved, is_joined = _move(search, workspace, carried[origin], to)
                carried[to[is_joined]], region[to[is_joined]] = moved[is_joined], n_regions
                front += to[is_joined].tolist()
                pairs = [(a, b) for a, b in pairs if region[b] < 0 and taken.get(b) != a]
        n_regions += 1
    return SlideField(carried, _by_size(region))


def _move(
    search: IkSearch, workspace: Workspace, q: NDArray[np.float64], to: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The configurations in which small steps to poses end, and which of these steps can be taken."""
    settings = search.settings
    end = descend(
        search.chain,
        q,
        workspace.positions_m[to],
        workspace.normals[to],
        position_tolerance_m=settings.position_tolerance_m,
        angle_tolerance_rad=settings.angle_tolerance_rad,
        max_steps=12,
        centring_gain=0.02,
    )
    is_near = end.distance_m <= settings.position_tolerance_m
    is_aligned = end.angle_rad <= settings.angle_tolerance_rad
    is_small = np.abs(end.q - q).max(axis=1) <= MAX_MOVE_RAD
    is_free = search.meter.measure(search.chain.full(end.q)).is_free
    return end.q, is_near & is_aligned & is_small & is_free


def _neighbours(workspace: Workspace) -> list[list[int]]:
    """The indices of the poses next to each pose."""
    count = min(N_NEIGHBOURS, workspace.n_poses - 1)
    if count < 1:
        return [[] for _ in range(workspace.n_poses)]
    found = KDTree(workspace.positions_m).query(workspace.positions_m, k=count + 1)
    # The nearest pose is the pose itself.
    away_m, index = (np.asarray(part)[:, 1:] for part in found)
    limit_m = MAX_GAP * float(np.median(away_m[:, 0]))
    return [row[near <= limit_m].tolist() for row, near in zip(index, away_m, strict=True)]


def _by_size(region: NDArray[np.int64]) -> NDArray[np.int64]:
    """The same regions, numbered by falling size."""
    is_in = region >= 0
    sizes = np.bincount(region[is_in]) if is_in.any() else np.zeros(0, dtype=np.int64)
    rank = np.empty(len(sizes), dtype=np.int64)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    numbered = np.full(len(region), -1, dtype=np.int64)
    numbered[is_in] = rank[region[is_in]]
    return numbered

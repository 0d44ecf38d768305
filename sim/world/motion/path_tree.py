"""RRT-Connect: two trees of configurations that grow towards each other until they meet (Kuffner and LaValle, 2000)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.world.ik.chain import Array

STEP = 0.4
"""A branch grows this far, the largest turn of a joint [rad or m]."""
MAX_BRANCHES = 300
"""Branches that are tried before the search is given up."""
MAX_CONNECT = 20
"""Most steps by which a tree tries to reach the other's new branch."""
SEED = 0
"""A constant of the algorithm, so that a path depends on nothing but its ends."""

IsFree = Callable[[Array, Array], bool]
"""Whether the straight way between two configurations is free."""


class _Tree:
    """Configurations, each with the one that it was reached from."""

    def __init__(self, root: Array) -> None:
        self.q, self.parents = [root], [-1]

    def nearest(self, q: Array) -> int:
        return int(np.argmin(np.abs(np.stack(self.q) - q).max(axis=1)))

    def add(self, q: Array, parent: int) -> int:
        self.q.append(q)
        self.parents.append(parent)
        return len(self.q) - 1

    def way_to(self, index: int) -> list[Array]:
        """Configurations from the root to a node."""
        way = []
        while index >= 0:
            way.insert(0, self.q[index])
            index = self.parents[index]
        return way


def connect_trees(start_q: Array, end_q: Array, is_free: IsFree, samples: Array) -> Array | None:
    """A free path between two configurations, shape (N, n), or None where none was found within the effort.

    Args:
        start_q: Free configuration, shape (n,).
        end_q: Another.
        is_free: Whether the straight way between two configurations is free.
        samples: Free configurations spread over the arm's reach that branches grow towards, shape (M, n).
    """
    rng = np.random.default_rng(SEED)
    near, far = _Tree(start_q), _Tree(end_q)
    for branch in range(MAX_BRANCHES):
        new = _grow(near, samples[rng.integers(len(samples))], is_free)
        met = None if new is None else _reach(far, near.q[new], is_free)
        if new is not None and met is not None:
            way = near.way_to(new) + far.way_to(met)[::-1]
            return np.stack(way if branch % 2 == 0 else way[::-1])
        near, far = far, near
    return None


def _grow(tree: _Tree, target: Array, is_free: IsFree) -> int | None:
    """A new branch of at most one step towards a configuration; None where it would touch something."""
    nearest = tree.nearest(target)
    away = target - tree.q[nearest]
    length = float(np.abs(away).max())
    q = target if length <= STEP else tree.q[nearest] + away * (STEP / length)
    return tree.add(q, nearest) if length > 0.0 and is_free(tree.q[nearest], q) else None


def _reach(tree: _Tree, target: Array, is_free: IsFree) -> int | None:
    """Grow towards a configuration until it is reached; None where something is in the way."""
    for _ in range(MAX_CONNECT):
        nearest = tree.nearest(target)
        if np.array_equal(tree.q[nearest], target):
            return nearest
        new = _grow(tree, target, is_free)
        if new is None:
            return None
    return None

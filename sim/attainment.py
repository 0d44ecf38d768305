"""What could be sensed at best: the union of the cones of all poses that the probe can reach."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .carrier import Carrier


def attainable(sees: NDArray[np.bool_], carrier: Carrier, *, max_failures: int = 100) -> NDArray[np.bool_]:
    """Which points some reachable pose sees, shape (n_points,).

    Asks for the pose that sees most of the points still open, until none is left to ask for, so that a few dozen IK
    answers settle what thousands would.

    Args:
        sees: Which poses see which points, shape (n_points, n_poses).
        carrier: Decides whether a pose is reached.
        max_failures: Unreachable poses asked for at most; beyond it the open points count as unattainable.
    """
    is_attained = np.zeros(len(sees), dtype=bool)
    n_open_seen = sees.sum(axis=0)
    n_failures = 0
    while n_open_seen.max(initial=0) > 0 and n_failures < max_failures:
        pose = int(np.argmax(n_open_seen))
        if not carrier.reach(pose).is_reached:
            n_failures += 1
            n_open_seen[pose] = -1
            continue
        newly = sees[:, pose] & ~is_attained
        is_attained |= newly
        n_open_seen -= sees[newly].sum(axis=0)
    return is_attained

"""Score of a reached pose: room to joint limits, to obstacles and to singularities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.world.ik.attempts import comfort_score
from sim.world.ik.chain import Chain

N_CONFIGURATIONS = 4000
"""Configurations that say what is usual for an arm: their median repeats to 3 %."""


class PoseScore:
    """Scores answers of one arm.

    Manipulability has the size of the arm in it, so it is held against the arm's own median over its joints' ranges.
    The configurations are drawn with a constant seed and concern nothing but the chain: an arm has one such number.

    Args:
        chain: The arm.
    """

    def __init__(self, chain: Chain) -> None:
        """Work out what is usual for the arm."""
        low, high = chain.search_range()
        q = np.random.default_rng(0).uniform(low, high, (N_CONFIGURATIONS, chain.n_joints))
        self._chain = chain
        self.usual_manipulability = float(np.median(chain.manipulability(q)))
        """Median of Yoshikawa's measure over the joints' ranges [m^3]."""

    def __call__(self, q: NDArray[np.float64], clearance_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Scores from 0 to 1.

            min(room / COMFORT_ROOM_RAD, clearance / COMFORT_CLEARANCE_M, manipulability / usual manipulability, 1)

        Args:
            q: Joint positions of the chain, shape (N, n).
            clearance_m: How far the arm is from table, organ and itself [m], shape (N,); NaN makes NaN.

        Returns:
            Shape (N,): 0 at a joint limit, in touch or in a singularity, 1 where more room would gain nothing.
        """
        room = self._chain.limit_room(q).min(axis=1)
        dexterity = self._chain.manipulability(q) / max(self.usual_manipulability, np.finfo(float).tiny)
        return np.minimum(comfort_score(room, clearance_m), dexterity)

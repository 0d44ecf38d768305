"""The start set: collision-free configurations spread over the arm's reach, of which the nearest start a solve."""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from sim.world.scene.clearance_meter import ClearanceMeter

from .chain import Array, Chain
from .damped_least_squares import AXIS_WEIGHT_M

N_DRAWN = 6000
"""Configurations drawn. Those that collide or whose tip is below the table are dropped, with a Panda one in nine."""
N_NEAREST = 20
"""Nearest configurations, which are taken one by one."""
N_FAR = 100
"""Farther ones, at growing distance, that may be taken after them."""


class StartSet:
    """Configurations from which the descent to a pose begins."""

    def __init__(self, chain: Chain, meter: ClearanceMeter, *, seed: int) -> None:
        """Draw the set by `seed`, which is the same for all episodes, so that a pose has one answer."""
        q = np.random.default_rng(seed).uniform(*chain.search_range(), (N_DRAWN, chain.n_joints))
        state = chain.forward(q)
        is_above = state.tips_m[:, 2] > 0.0
        q = q[is_above]
        self._keep(chain, np.vstack([chain.home, q[meter.measure(chain.full(q)).is_free]]))

    def _keep(self, chain: Chain, q: Array) -> None:
        state = chain.forward(q)
        self.q = q
        self._home = chain.home
        self._tree = KDTree(np.hstack([state.tips_m, AXIS_WEIGHT_M * state.beams]))

    def at_base(self, chain: Chain) -> StartSet:
        """The configurations of this set whose tip is above the table with the base where `chain` has it."""
        moved = copy.copy(self)
        is_above = chain.forward(self.q).tips_m[:, 2] > 0.0
        moved._keep(chain, self.q[is_above] if is_above.any() else self.q)
        return moved

    def starts(self, positions_m: Array, normals: Array, first: int, last: int) -> NDArray[np.float64]:
        """The starts `first` to `last` (exclusive) for each pose, shape (N, last - first, n).

        Start 0 is home. Then come the configurations whose tip and beam are nearest to the pose; after `N_NEAREST` of
        them ever farther ones, since the nearest may all share what made them fail.
        """
        ranks = _ranks(len(self.q))[first:last]
        is_home = ranks == 0
        features = np.hstack([positions_m, AXIS_WEIGHT_M * normals])
        found = np.asarray(self._tree.query(features, k=np.maximum(ranks, 1).tolist())[1])
        starts = self.q[found]
        starts[:, is_home] = self._home
        return starts

    def __len__(self) -> int:
        """How many starts a pose has at most."""
        return len(_ranks(len(self.q)))


def _ranks(n_configurations: int) -> NDArray[np.int64]:
    """Which nearest configurations are taken, in order; 0 stands for home."""
    near = np.arange(min(N_NEAREST, n_configurations) + 1)
    far = np.unique(np.geomspace(N_NEAREST + 2, max(n_configurations, N_NEAREST + 2), N_FAR).astype(np.int64))
    return np.concatenate([near, far[far <= n_configurations]])

"""Mean and variance of the latent on a lattice of query points, the variance carried along from reading to
reading.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kernel import AxisFeatures, Box, HingeFeatures, box_within, contract
from .lattice import Lattice


class LatticeMoments:
    """Latent without its offset at the points of a lattice, under a Gaussian belief over the weights.

    After a reading Sigma falls by G G^T, so the variance at x falls by |phi(x) G|^2, and only near the
    reading.
    """

    def __init__(self, features: HingeFeatures, query: Lattice, prior_variance: NDArray[np.float64]) -> None:
        """Starts at the prior variance of each query point, shape (query.n_points,)."""
        self._features = features
        self._query = query
        self._factors = features.on_lattice(query)
        self.variance = prior_variance.reshape(query.shape).copy()

    def mean(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns phi(x) . mu at all query points, shape (query.n_points,)."""
        tensor = np.zeros((*self._features.hinges.shape, 1))
        is_kept = self._features.weight_of_hinge >= 0
        tensor.reshape(-1)[is_kept] = weights
        return contract(self._factors, tensor).ravel()

    def lower_variance(self, touched: NDArray[np.intp], fall: NDArray[np.float64], cutoff: float) -> None:
        """Takes |phi(x) G|^2 off the variance, for G the rows `fall` (k, s) of the touched weights (k,)."""
        if fall.size == 0:
            return
        hinges = np.flatnonzero(self._features.weight_of_hinge >= 0)[touched]
        box, tensor = _spread_over_box(hinges, fall, self._features.hinges.shape)
        reach_m = self._features.reach_m(cutoff)
        corners = [
            axis[[part.start, part.stop - 1]]
            for axis, part in zip(self._features.hinges.axes_m, box, strict=True)
        ]
        low, high = np.transpose(corners) + np.array([[-reach_m], [reach_m]])
        near = box_within(self._query, low, high)
        x, y, z = (
            factor[rows, columns] for factor, rows, columns in zip(self._factors, near, box, strict=True)
        )
        # One plane of x at a time keeps the sums in the cache.
        for i, row in enumerate(range(near[0].start, near[0].stop)):
            sums = contract(AxisFeatures(x[i : i + 1], y, z), tensor)
            self.variance[row, near[1], near[2]] -= np.einsum("xyzr,xyzr->yz", sums, sums)


def _spread_over_box(
    hinges: NDArray[np.intp], rows: NDArray[np.float64], shape: tuple[int, int, int]
) -> tuple[Box, NDArray[np.float64]]:
    """Returns the smallest box that holds some hinges, and their rows laid out over it, zero elsewhere."""
    indices = np.unravel_index(hinges, shape)
    x, y, z = (slice(int(index.min()), int(index.max()) + 1) for index in indices)
    box = (x, y, z)
    tensor = np.zeros((x.stop - x.start, y.stop - y.start, z.stop - z.start, rows.shape[1]))
    tensor[tuple(index - part.start for index, part in zip(indices, box, strict=True))] = rows
    return box, tensor

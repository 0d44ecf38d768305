"""Where the covariance of the weights is kept: as one dense matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class DenseCovariance:
    """Sigma as one M x M matrix."""

    def __init__(self, n_weights: int, weight_variance: float) -> None:
        """Starts with independent weights of one variance."""
        self.matrix = np.zeros((n_weights, n_weights))
        np.fill_diagonal(self.matrix, weight_variance)
        self._all = np.arange(n_weights)

    def block(self, weights: NDArray[np.intp]) -> NDArray[np.float64]:
        """Returns a copy of the covariance of some weights (k,) among themselves, shape (k, k)."""
        return self.matrix[np.ix_(weights, weights)]

    def rows(self, weights: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Returns the weights (m,) that may covary with some weights (k,), and those rows, shape (k, m)."""
        return self._all, self.matrix[weights]

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.float64]) -> None:
        """Takes G G^T off the covariance of some weights (k,), for G of shape (k, s)."""
        self.matrix[np.ix_(weights, weights)] -= G @ G.T

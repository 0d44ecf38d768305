"""Where the covariance of the weights is kept: as one dense matrix."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky

from .storage import checked_array


class DenseCovariance:
    """Sigma as one M x M matrix."""

    def __init__(self, n_weights: int, weight_variance: float) -> None:
        """Starts with independent weights of one variance."""
        self.matrix = np.zeros((n_weights, n_weights))
        np.fill_diagonal(self.matrix, weight_variance)
        self._all = np.arange(n_weights)

    def cross(
        self, C: NDArray[np.float64], weights: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Returns the weights (m,) that may covary with some weights (k,), ascending, and C Sigma, shape
        (r, m).
        """
        return self._all, C @ self.matrix[weights]

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.float64], *, sign: float = 1.0) -> None:
        """Takes sign G G^T off the covariance of some weights (k,), for G of shape (k, s)."""
        fall = G @ G.T
        if sign < 0:
            np.negative(fall, out=fall)
        self.matrix[np.ix_(weights, weights)] -= fall

    def draw(self, n_samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Returns draws about zero with this covariance, shape (M, n_samples)."""
        factor = cholesky(self.matrix, lower=True, check_finite=False)
        return factor @ rng.standard_normal((len(self.matrix), n_samples))

    def state(self) -> dict[str, NDArray[np.float64]]:
        """Returns the lower triangle, row by row."""
        return {"covariance": self.matrix[np.tril_indices(len(self.matrix))]}

    def restore(self, state: Mapping[str, NDArray[np.float64]]) -> None:
        """Takes over a saved triangle.

        Raises:
            ValueError: If it is missing, of another size, or not positive definite.
        """
        n_weights = len(self.matrix)
        triangle = checked_array(state, "covariance", (n_weights * (n_weights + 1) // 2,))
        matrix = np.zeros_like(self.matrix)
        matrix[np.tril_indices(n_weights)] = triangle
        matrix += np.tril(matrix, -1).T
        try:
            cholesky(matrix, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            raise ValueError("its covariance is not positive definite") from None
        self.matrix = matrix

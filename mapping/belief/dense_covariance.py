"""The covariance of the weights as one dense matrix."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky

from ..kernel import HingeFeatures
from ..storage import checked_array
from .carried_variance import CarriedVariance
from .kept_covariance import KeptCovariance

# Hinges beyond a reading's own, along x, that may covary with them: the correlation halves with each.
_MARGIN = 6


class DenseCovariance(KeptCovariance):
    """Sigma as one M x M matrix."""

    def __init__(
        self,
        features: HingeFeatures,
        weight_variance: float,
        carried: CarriedVariance | None = None,
        *,
        is_exact: bool,
    ) -> None:
        """Starts with independent weights of one variance.

        Args:
            features: The features whose weights these are.
            weight_variance: Variance of each weight before any reading.
            carried: A variance that is to fall along with the covariance; None for none.
            is_exact: Whether any two weights may covary, or only those whose hinges are near one another.
        """
        super().__init__(features, carried)
        self._is_exact = is_exact
        self.matrix = np.zeros((features.n_weights, features.n_weights))
        np.fill_diagonal(self.matrix, weight_variance)
        n_in_plane = features.hinges.n_points // features.hinges.shape[0]
        self._plane_of_weight = np.flatnonzero(features.weight_of_hinge >= 0) // n_in_plane

    def among(self, C: NDArray[np.float64], weights: NDArray[np.intp]) -> NDArray[np.float64]:
        """See `KeptCovariance.among`."""
        return C @ self.matrix[np.ix_(weights, weights)]

    def cross(
        self, C: NDArray[np.float64], weights: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """See `KeptCovariance.cross`."""
        first, last = self._slab(weights)
        return np.arange(first, last), C @ self.matrix[weights, first:last]

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.float64], *, sign: float = 1.0) -> None:
        """See `KeptCovariance.lower`."""
        runs = self._runs(weights, G)
        # One pair of planes at a time stays in the cache.
        for number, (here, rows) in enumerate(runs):
            signed = sign * rows
            for there, others in runs[number:]:
                block = self.matrix[here, there]
                block -= signed @ others.T
                if there != here:
                    self.matrix[there, here] = block.T
        if self._carried is not None:
            self._carried.lower(weights, G, sign=sign)

    def _runs(
        self, weights: NDArray[np.intp], G: NDArray[np.float64]
    ) -> list[tuple[slice, NDArray[np.float64]]]:
        """G plane by plane of hinges: a range of weights and its rows, zero for weights to which none belongs."""
        starts = np.flatnonzero(np.diff(self._plane_of_weight[weights], prepend=-1))
        runs = []
        for some, rows in zip(np.split(weights, starts[1:]), np.split(G, starts[1:]), strict=True):
            first, last = int(some[0]), int(some[-1]) + 1
            filled = np.zeros((last - first, G.shape[1]))
            filled[some - first] = rows
            runs.append((slice(first, last), filled))
        return runs

    def _slab(self, weights: NDArray[np.intp]) -> tuple[int, int]:
        """The range of the weights, which run along x slowest, that may covary with some weights."""
        if self._is_exact:
            return 0, len(self.matrix)
        planes = self._plane_of_weight
        low, high = planes[weights.min()] - _MARGIN, planes[weights.max()] + _MARGIN
        return int(np.searchsorted(planes, low)), int(np.searchsorted(planes, high, side="right"))

    def draw(self, n_samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draws about zero with this covariance, shape (M, n_samples)."""
        factor = cholesky(self.matrix, lower=True, check_finite=False)
        return factor @ rng.standard_normal((len(self.matrix), n_samples))

    def state(self) -> dict[str, NDArray]:
        """The lower triangle row by row, what differs from it above the diagonal, and the variance that is carried.

        Products of a plane of hinges with itself round differently above and below the diagonal, and a map that goes
        on from a file is to give the same bytes.
        """
        differs = np.flatnonzero(np.triu(self.matrix != self.matrix.T))
        state = {
            "covariance": self.matrix[np.tril_indices(len(self.matrix))],
            "rounded_at": differs,
            "rounded": self.matrix.ravel()[differs],
        }
        return state if self._carried is None else {"carried_variance": self._carried.values, **state}

    def restore(self, state: Mapping[str, NDArray]) -> None:
        """Takes over a saved covariance.

        Raises:
            KeyError: If an array is missing.
            ValueError: If an array is of another size or not finite, or the matrix is not positive definite.
        """
        n_weights = len(self.matrix)
        triangle = checked_array(state, "covariance", (n_weights * (n_weights + 1) // 2,))
        matrix = np.zeros_like(self.matrix)
        matrix[np.tril_indices(n_weights)] = triangle
        matrix += np.tril(matrix, -1).T
        differs = np.asarray(state["rounded_at"])
        rounded = checked_array(state, "rounded", differs.shape)
        if (
            differs.ndim != 1
            or differs.dtype.kind != "i"
            or not np.all((differs >= 0) & (differs < matrix.size))
        ):
            raise ValueError("its array 'rounded_at' does not hold places of the covariance")
        matrix.ravel()[differs] = rounded
        try:
            cholesky(matrix, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            raise ValueError("its covariance is not positive definite") from None
        if self._carried is not None:
            self._carried.values = checked_array(state, "carried_variance", self._carried.values.shape)
        self.matrix = matrix

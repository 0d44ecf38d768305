"""The covariance of the weights as one dense matrix.

What a reading takes off the matrix only the next reading needs, so it is put off until somebody looks at the matrix, or
until there is time (`settle`). The variance on the lattice, which a prediction needs, falls at once.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, get_lapack_funcs

from ..kernel import HingeFeatures
from ..storage import checked_array
from .carried_variance import CarriedVariance
from .kept_covariance import KeptCovariance
from .pair_features import PairFeatures

# Hinges beyond a reading's own, along x, that may covary with them: the correlation halves with each.
_MARGIN = 6
# Directions whose products with the matrix are formed together.
_DIRECTIONS = 64
# Rows of the matrix that fall together.
_PANEL = 128


class DenseCovariance(KeptCovariance):
    """Sigma as one M x M matrix."""

    def __init__(
        self,
        features: HingeFeatures,
        weight_variance: float,
        carried: CarriedVariance | None = None,
        *,
        is_exact: bool,
        precision: type[np.floating] = np.float64,
    ) -> None:
        """Starts with independent weights of one variance.

        Args:
            features: The features whose weights these are.
            weight_variance: Variance of each weight before any reading.
            carried: A variance that is to fall along with the covariance; None for none.
            is_exact: Whether any two weights may covary, or only those whose hinges are near one another.
            precision: Type in which it is kept.
        """
        super().__init__(features, carried)
        self._is_exact = is_exact
        self._precision = precision
        self._matrix = np.zeros((features.n_weights, features.n_weights), dtype=self._precision)
        np.fill_diagonal(self._matrix, weight_variance)
        self._owed: list[tuple[NDArray[np.intp], NDArray[np.floating], float]] = []
        n_in_plane = features.hinges.n_points // features.hinges.shape[0]
        self._plane_of_weight = np.flatnonzero(features.weight_of_hinge >= 0) // n_in_plane

    @property
    def matrix(self) -> NDArray[np.floating]:
        """Sigma, shape (M, M)."""
        self.settle()
        return self._matrix

    def among(self, C: NDArray[np.float64], weights: NDArray[np.intp]) -> NDArray[np.float64]:
        """See `KeptCovariance.among`."""
        return C @ self.matrix[np.ix_(weights, weights)]

    def cross(
        self, C: NDArray[np.float64], weights: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.floating]]:
        """See `KeptCovariance.cross`."""
        first, last = self._slab(weights)
        products = np.empty((len(C), last - first), dtype=self._precision)
        # Directions are local: those that lie together share the weights that they have anything in.
        order = np.argsort(np.abs(C).argmax(axis=1), kind="stable")
        for some in np.array_split(order, max(1, len(order) // _DIRECTIONS)):
            rows = C[some]
            within = np.flatnonzero(rows.any(axis=0))
            products[some] = (
                rows[:, within].astype(self._precision) @ self.matrix[weights[within], first:last]
            )
        return np.arange(first, last), products

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.floating], *, sign: float = 1.0) -> None:
        """See `KeptCovariance.lower`; the matrix itself falls when it is next looked at."""
        self._owed.append((weights, G, sign))
        if self._carried is not None:
            self._carried.lower(weights, G, sign=sign)

    def settle(self) -> None:
        """See `KeptCovariance.settle`."""
        owed, self._owed = self._owed, []
        for weights, G, sign in owed:
            self._fall(weights, G, sign)

    def _fall(self, weights: NDArray[np.intp], G: NDArray[np.floating], sign: float) -> None:
        first, last = int(weights[0]), int(weights[-1]) + 1
        # Rows of zeros for the weights between cost less than picking entries out of the matrix.
        rows = np.zeros((last - first, G.shape[1]), dtype=self._precision)
        rows[weights - first] = G
        part = self._matrix[first:last, first:last]
        # A panel of rows at a time stays in the cache; what lies above the diagonal is copied, not computed.
        for start in range(0, len(rows), _PANEL):
            here = slice(start, min(start + _PANEL, len(rows)))
            panel = part[here, : here.stop]
            panel -= (rows[here] if sign > 0 else -rows[here]) @ rows[: here.stop].T
            corner = panel[:, start:]
            corner[:] = np.tril(corner) + np.tril(corner, -1).T
            part[:start, here] = panel[:, :start].T

    def _slab(self, weights: NDArray[np.intp]) -> tuple[int, int]:
        """The range of the weights, which run along x slowest, that may covary with some weights."""
        if self._is_exact:
            return 0, len(self._matrix)
        planes = self._plane_of_weight
        low, high = planes[weights.min()] - _MARGIN, planes[weights.max()] + _MARGIN
        return int(np.searchsorted(planes, low)), int(np.searchsorted(planes, high, side="right"))

    def draw(self, n_samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draws about zero with this covariance, shape (M, n_samples)."""
        factor = cholesky(self.matrix.astype(np.float64), lower=True, check_finite=False)
        return factor @ rng.standard_normal((len(self.matrix), n_samples))

    def become(
        self, precision: NDArray[np.float64], information: NDArray[np.float64], pairs: PairFeatures
    ) -> NDArray[np.float64]:
        """Becomes the inverse of a precision P, and the variance that is carried what follows from it.

        Args:
            precision: P, shape (M, M).
            information: P mu, shape (M,).
            pairs: The products of two features.

        Returns:
            mu, shape (M,).
        """
        # The transpose, which is the same matrix, lies in memory as LAPACK wants it.
        P = precision.astype(self._precision).T
        factor = cho_factor(P, lower=True, overwrite_a=True, check_finite=False)
        mean = cho_solve(factor, information.astype(self._precision)).astype(np.float64)
        # One step of refinement makes up for what single precision lost.
        mean += cho_solve(factor, (information - precision @ mean).astype(self._precision))
        (invert,) = get_lapack_funcs(("potri",), factor[:1])
        inverse, _ = invert(factor[0], lower=True, overwrite_c=True)
        above, self._owed = inverse.T, []
        for start in range(0, len(above), _PANEL):
            here = slice(start, start + _PANEL)
            corner = np.triu(above[here, here])
            self._matrix[here, here] = corner + np.triu(corner, 1).T
            self._matrix[here, here.stop :] = above[here, here.stop :]
            self._matrix[here.stop :, here] = above[here, here.stop :].T
        if self._carried is not None:
            self._carried.values = pairs.variance_on_lattice(self._matrix, self._carried.query)
        return mean

    def state(self) -> dict[str, NDArray]:
        """The lower triangle row by row, and the variance that is carried; what lies above the diagonal equals it."""
        state = {"covariance": self.matrix[np.tril_indices(len(self.matrix))]}
        return state if self._carried is None else {"carried_variance": self._carried.values, **state}

    def restore(self, state: Mapping[str, NDArray]) -> None:
        """Takes over a saved covariance.

        Raises:
            KeyError: If an array is missing.
            ValueError: If an array is of another size or not finite, or the matrix is not positive definite.
        """
        n_weights = len(self._matrix)
        triangle = checked_array(state, "covariance", (n_weights * (n_weights + 1) // 2,))
        matrix = np.zeros_like(self._matrix)
        matrix[np.tril_indices(n_weights)] = triangle
        matrix += np.tril(matrix, -1).T
        try:
            cholesky(matrix.astype(np.float64), lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            raise ValueError("its covariance is not positive definite") from None
        if self._carried is not None:
            self._carried.values = checked_array(state, "carried_variance", self._carried.values.shape)
        self._matrix, self._owed = matrix, []

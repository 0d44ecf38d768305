"""Where the covariance of the weights is kept: as one dense matrix, with its variance at points beside it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky

from .kernel import Box, HingeFeatures
from .lattice import Lattice
from .storage import checked_array
from .variance_field import VarianceField

# Hinges beyond a reading's own, along x, that may covary with them: the correlation halves with each.
_MARGIN = 6


class DenseCovariance:
    """Sigma as one M x M matrix, and its variance at points."""

    def __init__(self, features: HingeFeatures, weight_variance: float, *, is_exact: bool) -> None:
        """Starts with independent weights of one variance; exact, it takes any two weights for dependent."""
        self._features = features
        self._is_exact = is_exact
        self.matrix = np.zeros((features.n_weights, features.n_weights))
        np.fill_diagonal(self.matrix, weight_variance)
        self._variance = VarianceField(features, weight_variance)

    def inner(self, C: NDArray[np.float64], weights: NDArray[np.intp]) -> NDArray[np.float64]:
        """Returns C Sigma C^T among some weights (k,), for C of shape (r, k)."""
        return C @ self.matrix[np.ix_(weights, weights)] @ C.T

    def cross(
        self, C: NDArray[np.float64], weights: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Returns the weights (m,) that may covary with some weights (k,), ascending, and C Sigma, shape
        (r, m).
        """
        first, last = self._slab(weights)
        return np.arange(first, last), C @ self.matrix[weights, first:last]

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.float64], *, sign: float = 1.0) -> None:
        """Takes sign G G^T off the covariance of some weights (k,), for G of shape (k, s)."""
        box = self._features.box_of(weights)
        tensor = self._features.over_box(weights, G, box)
        strips = _strips(tensor)
        sums = self._variance.pair_sums(box)
        # One pair of planes at a time stays in the cache, and serves the covariance and its variance alike.
        for i, here in enumerate(strips):
            left = tensor[i, here].reshape(-1, G.shape[1])
            for j, there in enumerate(strips[i:], start=i):
                products = left @ tensor[j, there].reshape(-1, G.shape[1]).T
                sums.add((i, here), (j, there), products)
                products *= sign
                self._lower_block(
                    self._places(box, i, here), self._places(box, j, there), products, mirror=i != j
                )
        self._variance.lower(box, sums, sign=sign)

    def _places(self, box: Box, plane: int, strip: slice) -> tuple[int, slice, slice]:
        """Returns where a strip of a plane of a box lies in the lattice: its x, and its ranges along y and
        z.
        """
        return box[0].start + plane, slice(box[1].start + strip.start, box[1].start + strip.stop), box[2]

    def _lower_block(
        self,
        here: tuple[int, slice, slice],
        there: tuple[int, slice, slice],
        fall: NDArray[np.float64],
        *,
        mirror: bool,
    ) -> None:
        """Takes a block off the covariance of the hinges of two strips, and off its mirror."""
        shape = self._features.hinges.shape
        if len(self.matrix) == np.prod(shape):
            lattice = self.matrix.reshape(*shape, *shape)
            block = lattice[*here, *there]
            block -= fall.reshape(block.shape)
            if mirror:
                block = lattice[*there, *here]
                block -= fall.T.reshape(block.shape)
            return
        weight_of_hinge = self._features.weight_of_hinge.reshape(shape)
        rows, columns = weight_of_hinge[here].ravel(), weight_of_hinge[there].ravel()
        fall = fall[np.ix_(rows >= 0, columns >= 0)]
        rows, columns = rows[rows >= 0], columns[columns >= 0]
        self.matrix[np.ix_(rows, columns)] -= fall
        if mirror:
            self.matrix[np.ix_(columns, rows)] -= fall.T

    def _slab(self, weights: NDArray[np.intp]) -> tuple[int, int]:
        """Returns the range of weights, which run along x slowest, whose hinges may covary with some
        weights'.
        """
        if self._is_exact:
            return 0, len(self.matrix)
        n_x = self._features.hinges.shape[0]
        box = self._features.box_of(weights)
        plane_of_weight = np.flatnonzero(self._features.weight_of_hinge >= 0) // (
            self._features.hinges.n_points // n_x
        )
        low, high = box[0].start - _MARGIN, box[0].stop + _MARGIN
        return int(np.searchsorted(plane_of_weight, low)), int(np.searchsorted(plane_of_weight, high))

    def variance_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """Returns the variance of the latent at all points of a lattice."""
        return self._variance.on_lattice(query)

    def variance_at(self, points_m: NDArray[np.float64], cutoff: float) -> NDArray[np.float64]:
        """Returns the variance of the latent at points that lie close together, shape (N, 3)."""
        return self._variance.at(points_m, cutoff)

    def draw(self, n_samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Returns draws about zero with this covariance, shape (M, n_samples)."""
        factor = cholesky(self.matrix, lower=True, check_finite=False)
        return factor @ rng.standard_normal((len(self.matrix), n_samples))

    def state(self) -> dict[str, NDArray[np.float64]]:
        """Returns the lower triangle, row by row, and the coefficients of the variance."""
        triangle = self.matrix[np.tril_indices(len(self.matrix))]
        return {"covariance": triangle, "variance_coefficients": self._variance.coefficients}

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
        coefficients = self._variance.coefficients
        self._variance.coefficients = checked_array(state, "variance_coefficients", coefficients.shape)
        self.matrix = matrix


def _strips(tensor: NDArray[np.float64]) -> list[slice]:
    """Returns for each plane of G over a box, (n_x, n_y, n_z, s), the range along y outside which it is
    zero.
    """
    is_touched = np.any(tensor != 0, axis=(2, 3))
    strips = []
    for row in is_touched:
        touched = np.flatnonzero(row)
        strips.append(slice(int(touched[0]), int(touched[-1]) + 1) if touched.size else slice(0, 0))
    return strips

"""The coordinates in which a reading is taken in: a few numbers z, standard normal under the belief of the moment.

With Phi = T C the reduced features of a reading and C Sigma C^T = R R^T, z = R^-1 C (w - mu) is N(0, I), and the latent
at the reading's points is m + B z, B = T R. A belief over z goes back to the weights through Y = Sigma C^T R^-T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from .reduction import Reduction, pivoted_cholesky


@dataclass(frozen=True, eq=False)
class ReadingCoordinates:
    """One reading under one belief."""

    mean: NDArray[np.float64]
    """m, the latent's mean at the reading's points, shape (n,)."""
    basis: NDArray[np.float64]
    """B, shape (n, r)."""
    near: NDArray[np.intp]
    """Weights that the reading's features touch, shape (h,)."""
    inverse_root: NDArray[np.float64]
    """R^-1, shape (r, r)."""
    directions: NDArray[np.float64]
    """C, shape (r, h)."""
    others: NDArray[np.intp]
    """Weights that may covary with those, ascending, shape (m,)."""
    products: NDArray[np.floating]
    """C Sigma for these, shape (r, m)."""

    def to_reading(self, deviations: NDArray[np.float64]) -> NDArray[np.float64]:
        """The coordinates z = R^-1 C d of deviations d of all weights from their mean, shape (M, S)."""
        return self.inverse_root @ (self.directions @ deviations[self.near])

    def rows(self, values: NDArray[np.float64]) -> NDArray[np.floating]:
        """(Y values)^T at the weights `others`, shape (s, m), for values over z of shape (r, s)."""
        return (values.T @ self.inverse_root).astype(self.products.dtype) @ self.products


def reading_coordinates(
    reduction: Reduction,
    prior_mean: NDArray[np.float64],
    others: NDArray[np.intp],
    products: NDArray[np.floating],
    *,
    tolerance: float,
) -> ReadingCoordinates:
    """The coordinates of a reading.

    Args:
        reduction: Its reduced features.
        prior_mean: The latent's mean at its points before the reading, shape (n,).
        others: Weights that may covary with those that its features touch, ascending; these are among them.
        products: C Sigma at the others, from which both C Sigma C^T and all that goes back to the weights follow.
        tolerance: Variance at a pivot, given the others, below which the pivot is left out; 0 keeps all.
    """
    # `pstrf` and `potrf` read the lower triangle, so that rounding above it does not matter.
    covariance = products[:, np.searchsorted(others, reduction.hinges)] @ reduction.directions.T.astype(
        products.dtype
    )
    covariance = covariance.astype(np.float64)
    if tolerance > 0:
        root, pivots = pivoted_cholesky(covariance, tolerance)
    else:
        root, pivots = cholesky(covariance, lower=True, check_finite=False), np.arange(len(covariance))
    identity = np.eye(len(pivots))
    return ReadingCoordinates(
        mean=prior_mean,
        basis=reduction.at_points(root),
        near=reduction.hinges,
        inverse_root=solve_triangular(root[pivots], identity, lower=True, check_finite=False),
        directions=reduction.directions[pivots],
        others=others,
        products=products[pivots],
    )

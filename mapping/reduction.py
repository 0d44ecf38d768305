"""A reading in few dimensions: the latent at all its points from the latent along a few directions of
weight space.

A cone holds a thousand points but only some hundred of them can be told apart at the width of the kernel.
With Phi the features of the reading (n x h), the pivoted Cholesky factor of Phi Phi^T finds points p from
which all the others follow, Phi = T Phi_p, so that everything that is repeated within a reading works with
r numbers in place of n or h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs, solve_triangular

from .kernel import AxisFeatures, feature_products, outer_features


@dataclass(frozen=True, eq=False)
class Reduction:
    """Features of a reading as Phi = T C, of rank r."""

    interpolation: NDArray[np.float64]
    """T, shape (n, r)."""
    directions: NDArray[np.float64]
    """C, shape (r, h)."""
    hinges: NDArray[np.intp]
    """Which columns of the features these h are."""


def pivoted_cholesky(
    matrix: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Returns L (n x r) and the pivots p (r,) with L L^T = matrix up to residual variances of at most
    `tolerance`.

    Row i of L belongs to row i of the matrix; L[p] is lower triangular.
    """
    (pstrf,) = get_lapack_funcs(("pstrf",), (matrix,))
    packed, order, rank, _ = pstrf(matrix, tol=tolerance, lower=1)
    pivots = np.asarray(order, dtype=np.intp) - 1
    factor = np.empty((len(matrix), rank))
    factor[pivots] = np.tril(packed[:, :rank])
    return factor, pivots[:rank]


def reduce_by_pivots(
    factors: AxisFeatures, is_active: NDArray[np.bool_], tolerance: float, cutoff: float
) -> Reduction:
    """Returns the reduction that interpolates from chosen points of the reading.

    Args:
        factors: Factors of the features of n points over a box of hinges.
        is_active: Which hinges of the box exist, in C order.
        tolerance: Largest squared residual |phi - T phi_p|^2 of a point, relative to the largest |phi|^2.
        cutoff: Columns of C whose entries all are smaller than this are left out.
    """
    products = feature_products(factors, factors)
    factor, pivots = pivoted_cholesky(products, tolerance * products.diagonal().max())
    # T = L L_p^-1
    interpolation = solve_triangular(factor[pivots], factor.T, lower=True, trans=1, check_finite=False).T
    chosen = outer_features(AxisFeatures(*(factor_d[pivots] for factor_d in factors)))
    hinges = np.flatnonzero(is_active & (chosen.max(axis=0, initial=0) > cutoff))
    return Reduction(interpolation, chosen[:, hinges], hinges)


def reduce_exactly(factors: AxisFeatures, is_active: NDArray[np.bool_]) -> Reduction:
    """Returns the reduction without loss, from an orthogonal basis of the features' rows: Phi^T = Q R, T =
    R^T, C = Q^T.
    """
    hinges = np.flatnonzero(is_active)
    basis, triangle = np.linalg.qr(outer_features(factors)[:, hinges].T)
    return Reduction(triangle.T, np.ascontiguousarray(basis.T), hinges)

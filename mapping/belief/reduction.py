"""A reading in few dimensions: the latent at all its points from the latent along a few directions of weight space.

A cone holds a thousand points, but only some hundred of them can be told apart at the width of the kernel. With Phi the
features of the reading (n x h), the pivoted Cholesky factor of Phi Phi^T finds points p from which all the others
follow, Phi = T Phi_p, so that everything that is repeated within a reading works with r numbers in place of n or h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs, solve_triangular

from ..kernel import AxisFeatures, feature_products, outer_features

# Candidates for pivots at a time: above a cone's rank at the default tolerance, few enough for the cache.
_MAX_CANDIDATES = 400


@dataclass(frozen=True, eq=False)
class Reduction:
    """Features of a reading as Phi = T C, of rank r, with T = L L_p^-1 kept as its two factors."""

    factor: NDArray[np.float64]
    """L, shape (n, r)."""
    triangle: NDArray[np.float64]
    """L_p, lower triangular, shape (r, r)."""
    directions: NDArray[np.float64]
    """C, shape (r, h)."""
    hinges: NDArray[np.intp]
    """Which columns of the features these h are."""

    def at_points(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """What holds at the n points, T values, when `values` hold along the directions, shape (r,) or (r, k)."""
        return self.factor @ _solve_triangle(self.triangle, values)


def pivoted_cholesky(
    matrix: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """The factor L, shape (n, r), and the pivots p, shape (r,), with L L^T = matrix but for small residual variances.

    Row i of L belongs to row i of the matrix; L[p] is lower triangular.

    Args:
        matrix: A positive semidefinite matrix, shape (n, n).
        tolerance: Largest residual variance, an entry of the diagonal of matrix - L L^T.
    """
    (pstrf,) = get_lapack_funcs(("pstrf",), (matrix,))
    packed, order, rank, _ = pstrf(matrix, tol=tolerance, lower=1)
    pivots = np.asarray(order, dtype=np.intp) - 1
    factor = np.empty((len(matrix), rank))
    factor[pivots] = np.tril(packed[:, :rank])
    return factor, pivots[:rank]


def choose_pivots(factors: AxisFeatures, tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """The pivoted Cholesky factor L of Phi Phi^T, shape (n, r), and its pivots, shape (r,).

    Pivots are sought among a few hundred points at a time, then among those that do not follow from them
    yet, so that the n x n matrix is never formed.

    Args:
        factors: Factors of the features of n points.
        tolerance: Largest squared residual |phi - T phi_p|^2 of a point, relative to the largest |phi|^2.
    """
    residual = _squared_norms(factors)
    limit = tolerance * residual.max()
    factor, pivots = np.zeros((len(residual), 0)), np.zeros(0, dtype=np.intp)
    while (left := np.flatnonzero(residual > limit)).size:
        candidates = left[:: -(-left.size // _MAX_CANDIDATES)]
        some = _rows(factors, candidates)
        rest = feature_products(some, some) - factor[candidates] @ factor[candidates].T
        triangle, order = pivoted_cholesky(rest, limit)
        chosen = candidates[order]
        columns = feature_products(factors, _rows(factors, chosen)) - factor @ factor[chosen].T
        columns = columns @ _solve_triangle(triangle[order], np.eye(len(order))).T
        residual -= np.einsum("nr,nr->n", columns, columns)
        residual[chosen] = 0
        factor, pivots = np.hstack([factor, columns]), np.append(pivots, chosen)
    return factor, pivots


def reduce_by_pivots(
    factors: AxisFeatures, is_active: NDArray[np.bool_], *, tolerance: float, cutoff: float
) -> Reduction:
    """The reduction that interpolates from chosen points of the reading.

    Args:
        factors: Factors of the features of n points over a box of hinges.
        is_active: Which hinges of the box exist, in C order.
        tolerance: As in `choose_pivots`.
        cutoff: Entries of C that are smaller than this are taken as zero, and columns without others are left out.
    """
    factor, pivots = choose_pivots(factors, tolerance)
    Phi = outer_features(_rows(factors, pivots))
    hinges = np.flatnonzero(is_active & (Phi.max(axis=0, initial=0) > cutoff))
    directions = Phi[:, hinges]
    directions[directions <= cutoff] = 0
    return Reduction(factor, factor[pivots], directions, hinges)


def reduce_exactly(factors: AxisFeatures, is_active: NDArray[np.bool_]) -> Reduction:
    """The reduction without loss, from an orthogonal basis of the features' rows: Phi^T = Q R, T = R^T, C = Q^T.

    Args:
        factors: Factors of the features of n points over a box of hinges.
        is_active: Which hinges of the box exist, in C order.
    """
    hinges = np.flatnonzero(is_active)
    basis, triangle = np.linalg.qr(outer_features(factors)[:, hinges].T)
    return Reduction(triangle.T, np.eye(len(triangle)), np.ascontiguousarray(basis.T), hinges)


def _rows(factors: AxisFeatures, points: NDArray[np.intp]) -> AxisFeatures:
    return AxisFeatures(*(factor[points] for factor in factors))


def _squared_norms(factors: AxisFeatures) -> NDArray[np.float64]:
    x, y, z = (np.einsum("ni,ni->n", factor, factor) for factor in factors)
    return x * y * z


def _solve_triangle(lower: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    return solve_triangular(lower, right, lower=True, check_finite=False)

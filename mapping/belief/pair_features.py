"""Products of two features, which are features too: with them all readings are laid into a belief at once.

    k(x, h) k(x, h') = exp(-gamma |h - h'|^2 / 2) exp(-2 gamma |x - (h + h') / 2|^2)

The first factor knows no point, and the second depends on the middle of the two hinges alone. The hinges lie on a
lattice, so their middles lie on one of half its spacing, with some eight times as many points, where there are M^2
pairs. What a sum over points needs of all pairs is therefore a sum of single features, F:

    (Phi^T W Phi)_hh' = exp(-gamma |h - h'|^2 / 2) F((h + h') / 2),   F(c) = sum_n w_n exp(-2 gamma |x_n - c|^2),

and the variance phi(x) Sigma phi(x)^T is one feature row of the middles times the sums of the covariance over the
pairs with each middle. Both are exact.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from ..kernel import AxisFeatures, HingeFeatures, contract
from ..lattice import Lattice

Array = NDArray[np.float64]
_CUTOFF = 1e-12
"""Features of a middle that are smaller than this are left out: single precision has 1e-7."""
_LEAST = 1e-15
"""Sums smaller than this are zeros: in single precision they could be denormal numbers, which are slow."""
_ROWS = 64
"""Rows of the pairs' matrix at a time, so that little of it is there beside the result."""


class PairFeatures:
    """The middles of all pairs of hinges, and the factor of each pair."""

    def __init__(self, features: HingeFeatures) -> None:
        """Takes the features whose pairs these are."""
        hinges = np.flatnonzero(features.weight_of_hinge >= 0)
        indices = np.unravel_index(hinges, features.hinges.shape)
        middles = Lattice(_halved(features.hinges))
        self._middles = HingeFeatures.build(middles, 2.0 * features.gamma_per_m2)
        strides = np.array([middles.shape[1] * middles.shape[2], middles.shape[2], 1])
        # The index of a pair's middle is the sum of its hinges' own.
        self._own = (np.transpose(indices) * strides).sum(axis=1)
        self._hinges_m = features.hinges.points_m()[hinges]
        self._gamma_per_m2 = features.gamma_per_m2

    def precision(self, readings: Iterable[tuple[Array, Array]]) -> Array:
        """Phi^T W Phi over the points of some readings, shape (M, M).

        Args:
            readings: Points [m], shape (n, 3), and their weights w, shape (n,), of each.
        """
        sums = np.zeros(self._middles.hinges.shape)
        for points_m, weight in readings:
            box = self._middles.box_around(points_m, _CUTOFF)
            sums[box] += summed_features(self._middles.along_axes(points_m, box), weight)
        flat, products = sums.ravel(), np.empty((len(self._own), len(self._own)))
        for rows, middles, factors in self._pairs():
            of_pairs = flat[middles] * factors
            of_pairs[np.abs(of_pairs) < _LEAST] = 0.0
            products[rows] = of_pairs
        return products

    def variance_on_lattice(self, covariance: NDArray[np.floating], query: Lattice) -> Array:
        """The variance phi Sigma phi^T at the points of a lattice, in its shape.

        Args:
            covariance: Sigma, shape (M, M).
            query: The lattice.
        """
        middles = self._middles.hinges
        sums = np.zeros(middles.n_points)
        for rows, of_pairs, factors in self._pairs():
            sums += np.bincount(of_pairs.ravel(), (covariance[rows] * factors).ravel(), middles.n_points)
        return contract(self._middles.on_lattice(query), sums.reshape(*middles.shape, 1))[..., 0]

    def _pairs(self) -> Iterator[tuple[slice, NDArray[np.intp], Array]]:
        """For some rows at a time: the indices of the pairs' middles, and exp(-gamma |h - h'|^2 / 2), shapes (k, M)."""
        for start in range(0, len(self._own), _ROWS):
            rows = slice(start, start + _ROWS)
            between_m2 = cdist(self._hinges_m[rows], self._hinges_m, "sqeuclidean")
            factors = np.exp(-0.5 * self._gamma_per_m2 * between_m2)
            yield rows, self._own[rows, None] + self._own, factors


def summed_features(factors: AxisFeatures, weight: Array) -> Array:
    """Sums of weighted features over n points, Phi^T w, on the lattice of their centres, shape (n_x, n_y, n_z).

    Args:
        factors: Factors of the features of the points, shapes (n, n_d).
        weight: Weight of each point, shape (n,).
    """
    xy = (weight[:, None] * factors.x)[:, :, None] * factors.y[:, None]
    sums = xy.reshape(len(weight), -1).T @ factors.z
    return sums.reshape(factors.x.shape[1], factors.y.shape[1], -1)


def _halved(lattice: Lattice) -> tuple[Array, Array, Array]:
    """The axes of a lattice with a point between each two of its own."""
    x, y, z = (np.linspace(axis[0], axis[-1], 2 * axis.size - 1) for axis in lattice.axes_m)
    return x, y, z

"""The variance of the latent as a map of its own, on a lattice twice as fine as the hinges.

The product of two features is a feature of twice the gamma at the midpoint of their hinges,

    phi_h(x) phi_h'(x) = exp(-gamma |h - h'|^2 / 2) exp(-2 gamma |x - (h + h') / 2|^2),

and midpoints of lattice points lie on a lattice of half the spacing. So the variance is a sum over that
lattice,

    v(x) = phi(x) Sigma phi(x)^T = sum_m c_m exp(-2 gamma |x - m|^2),
    c_m = sum_{h + h' = 2 m} Sigma_hh' exp(-gamma |h - h'|^2 / 2),

which costs the same at any point whatever the rank of what was learnt, and needs no covariance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kernel import HingeFeatures, contract, outer_features
from .lattice import Lattice


class VarianceField:
    """Coefficients c of the variance, lowered in place as the covariance falls."""

    def __init__(self, features: HingeFeatures, weight_variance: float) -> None:
        """Starts with independent weights of one variance."""
        self._hinges = features.hinges
        self._kept = np.flatnonzero(features.weight_of_hinge >= 0)
        self._midpoints = HingeFeatures.build(_halved(features.hinges), 2 * features.gamma_per_m2)
        # exp(-gamma |h - h'|^2 / 2) along each axis
        self._overlap = tuple(
            np.exp(-features.gamma_per_m2 / 2 * (axis[:, None] - axis) ** 2)
            for axis in features.hinges.axes_m
        )
        self.coefficients = np.zeros(self._midpoints.hinges.shape)
        prior = np.zeros(features.hinges.n_points)
        prior[self._kept] = weight_variance
        self.coefficients[::2, ::2, ::2] = prior.reshape(features.hinges.shape)

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.float64], *, sign: float = 1.0) -> None:
        """Takes the variance of sign G G^T off, for G the rows (k, s) of some weights (k,)."""
        if G.size == 0:
            return
        indices = np.unravel_index(self._kept[weights], self._hinges.shape)
        low = [int(index.min()) for index in indices]
        shape = [int(index.max()) + 1 - start for index, start in zip(indices, low, strict=True)]
        tensor = np.zeros((*shape, G.shape[1]))
        tensor[tuple(index - start for index, start in zip(indices, low, strict=True))] = G
        overlap = [
            part[start : start + n, start : start + n]
            for part, start, n in zip(self._overlap, low, shape, strict=True)
        ]
        box = tuple(slice(2 * start, 2 * (start + n) - 1) for start, n in zip(low, shape, strict=True))
        self.coefficients[box] -= sign * _pair_sums(tensor, overlap)

    def on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """Returns the variance at all points of a lattice, shape (query.n_points,)."""
        return contract(self._midpoints.on_lattice(query), self.coefficients[..., None]).ravel()

    def at(self, points_m: NDArray[np.float64], cutoff: float) -> NDArray[np.float64]:
        """Returns the variance at points that lie close together, shape (N, 3), from the midpoints within
        reach.
        """
        box = self._midpoints.box_around(points_m, cutoff)
        return outer_features(self._midpoints.along_axes(points_m, box)) @ self.coefficients[box].ravel()


def _halved(lattice: Lattice) -> Lattice:
    """Returns the lattice with the midpoints of all neighbours added."""
    x, y, z = (
        np.interp(np.arange(2 * axis.size - 1) / 2, np.arange(axis.size), axis) for axis in lattice.axes_m
    )
    return Lattice((x, y, z))


def _pair_sums(tensor: NDArray[np.float64], overlap: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Returns sum over pairs h + h' = 2 m of (G G^T)_hh' exp(-gamma |h - h'|^2 / 2), for G over a box of
    hinges.

    Args:
        tensor: G laid out over the box, shape (n_x, n_y, n_z, s).
        overlap: The exponential along each axis, shapes (n_d, n_d).

    Returns:
        The sums, shape (2 n_x - 1, 2 n_y - 1, 2 n_z - 1).
    """
    nx, ny, nz, rank = tensor.shape
    planes = tensor.reshape(nx, ny * nz, rank)
    over_x = np.zeros((2 * nx - 1, ny * nz, ny * nz))
    for i in range(nx):
        for j in range(i, nx):
            products = planes[i] @ planes[j].T
            # The pair (j, i) adds the transpose of (i, j), which is the same once the other axes are summed.
            products *= overlap[0][i, j] if i == j else 2 * overlap[0][i, j]
            over_x[i + j] += products
    over_y = np.zeros((2 * nx - 1, 2 * ny - 1, nz, nz))
    pairs = over_x.reshape(2 * nx - 1, ny, nz, ny, nz)
    for i in range(ny):
        over_y[:, i : i + ny] += np.moveaxis(pairs[:, i], 2, 1) * overlap[1][i][:, None, None]
    over_z = np.zeros((2 * nx - 1, 2 * ny - 1, 2 * nz - 1))
    for i in range(nz):
        over_z[:, :, i : i + nz] += over_y[:, :, i] * overlap[2][i]
    return over_z

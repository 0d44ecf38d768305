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

from .kernel import Box, HingeFeatures, contract, outer_features
from .lattice import Lattice


class VarianceField:
    """Coefficients c of the variance, lowered in place as the covariance falls."""

    def __init__(self, features: HingeFeatures, weight_variance: float) -> None:
        """Starts with independent weights of one variance."""
        self._midpoints = HingeFeatures.build(_halved(features.hinges), 2 * features.gamma_per_m2)
        # exp(-gamma |h - h'|^2 / 2) along each axis
        self._overlap = tuple(
            np.exp(-features.gamma_per_m2 / 2 * (axis[:, None] - axis) ** 2)
            for axis in features.hinges.axes_m
        )
        self.coefficients = np.zeros(self._midpoints.hinges.shape)
        prior = np.zeros(features.hinges.n_points)
        prior[features.weight_of_hinge >= 0] = weight_variance
        self.coefficients[::2, ::2, ::2] = prior.reshape(features.hinges.shape)

    def pair_sums(self, box: Box) -> PairSums:
        """Returns an empty sum over the pairs of hinges of a box."""
        overlap = [part[along, along] for part, along in zip(self._overlap, box, strict=True)]
        return PairSums(overlap)

    def lower(self, box: Box, sums: PairSums, *, sign: float = 1.0) -> None:
        """Takes the variance of sign G G^T off, for G G^T as summed over a box of hinges."""
        midpoints = tuple(slice(2 * part.start, 2 * part.stop - 1) for part in box)
        self.coefficients[midpoints] -= sign * sums.total()

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


class PairSums:
    """The sum over pairs h + h' = 2 m of (G G^T)_hh' exp(-gamma |h - h'|^2 / 2), one pair of planes at a
    time.
    """

    def __init__(self, overlap: list[NDArray[np.float64]]) -> None:
        """Starts at zero; `overlap` is the exponential along each axis of the box, shapes (n_d, n_d)."""
        self._overlap = overlap
        nx, ny, nz = (len(part) for part in overlap)
        self._over_x = np.zeros((2 * nx - 1, ny * nz, ny * nz))

    def add(self, here: tuple[int, slice], there: tuple[int, slice], products: NDArray[np.float64]) -> None:
        """Adds the part of G G^T between two strips, and its mirror.

        Args:
            here: A plane i of the box along x and the strip of it along y.
            there: Another, j >= i.
            products: G_here G_there^T, rows and columns along y and z.
        """
        (i, rows), (j, columns) = here, there
        n_z = len(self._overlap[2])
        # The mirror (j, i) is the transpose, which gives the same once the other axes are summed.
        factor = self._overlap[0][i, j] if i == j else 2 * self._overlap[0][i, j]
        into = self._over_x[
            i + j, rows.start * n_z : rows.stop * n_z, columns.start * n_z : columns.stop * n_z
        ]
        into += factor * products

    def total(self) -> NDArray[np.float64]:
        """Returns the sums, shape (2 n_x - 1, 2 n_y - 1, 2 n_z - 1)."""
        nx, ny, nz = (len(part) for part in self._overlap)
        pairs = self._over_x.reshape(2 * nx - 1, ny, nz, ny, nz)
        over_y = np.zeros((2 * nx - 1, 2 * ny - 1, nz, nz))
        for i in range(ny):
            over_y[:, i : i + ny] += np.moveaxis(pairs[:, i], 2, 1) * self._overlap[1][i][:, None, None]
        over_z = np.zeros((2 * nx - 1, 2 * ny - 1, 2 * nz - 1))
        for i in range(nz):
            over_z[:, :, i : i + nz] += over_y[:, :, i] * self._overlap[2][i]
        return over_z

"""The squared-exponential features of a Hilbert map on a lattice of hinges (the paper's Psi and eq. 1).

    k(x, h) = exp(-gamma |x - h|^2) = k_x(x_x, h_x) k_y(x_y, h_y) k_z(x_z, h_z)

The kernel is a product over the axes and the hinges lie on a lattice, so a row of features is an outer
product of three short vectors, and a weighted sum of features on a second lattice is three small matrix
products (a Kronecker product that is never formed). Features below `cutoff` are taken as zero, which makes
everything local.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .lattice import Lattice

Box = tuple[slice, slice, slice]
"""A box of lattice indices: one slice per axis."""


class AxisFeatures(NamedTuple):
    """The three factors of the features of N points, each of shape (N, number of hinges along that axis)."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HingeFeatures:
    """Squared-exponential features centred on the points of a lattice, some of which may be left out."""

    hinges: Lattice
    """Hinge points, the centres of the features."""
    gamma_per_m2: float
    """gamma of eq. 1 [1/m^2]."""
    weight_of_hinge: NDArray[np.intp]
    """Index of each hinge's weight, shape (hinges.n_points,), or -1 where the hinge is left out."""

    @classmethod
    def build(
        cls, hinges: Lattice, gamma_per_m2: float, hinge_mask: NDArray[np.bool_] | None = None
    ) -> HingeFeatures:
        """Returns the features of the hinges that the mask, shape (hinges.n_points,), keeps (all without a
        mask).
        """
        keep = (
            np.ones(hinges.n_points, dtype=bool) if hinge_mask is None else np.asarray(hinge_mask, dtype=bool)
        )
        if keep.shape != (hinges.n_points,) or not keep.any():
            raise ValueError(
                f"hinge_mask must keep at least one of {hinges.n_points} hinges; its shape is {keep.shape}"
            )
        return cls(hinges, gamma_per_m2, np.where(keep, np.cumsum(keep) - 1, -1))

    @property
    def n_weights(self) -> int:
        """Number of hinges that are kept."""
        return int(self.weight_of_hinge.max()) + 1

    @property
    def spacing_m(self) -> float:
        """Largest distance between neighbouring hinges along an axis [m]; 1 m for a single hinge."""
        return max((float(axis[1] - axis[0]) for axis in self.hinges.axes_m if axis.size > 1), default=1.0)

    def reach_m(self, cutoff: float) -> float:
        """Returns the distance [m] beyond which features are smaller than a cutoff (infinite for 0)."""
        return float(np.sqrt(-np.log(cutoff) / self.gamma_per_m2)) if cutoff > 0 else np.inf

    def box_around(self, points_m: NDArray[np.float64], cutoff: float) -> Box:
        """Returns the box of hinges within reach of the bounding box of points, shape (N, 3)."""
        reach_m = self.reach_m(cutoff)
        return box_within(self.hinges, points_m.min(axis=0) - reach_m, points_m.max(axis=0) + reach_m)

    def weights_in(self, box: Box) -> NDArray[np.intp]:
        """Returns the index of the weight of each hinge of a box, -1 where there is none, in C order."""
        return self.weight_of_hinge[box_indices(box, self.hinges.shape)]

    def box_of(self, weights: NDArray[np.intp]) -> Box:
        """Returns the smallest box of hinges that holds those of some weights, shape (k,), k > 0."""
        hinges = np.flatnonzero(self.weight_of_hinge >= 0)[weights]
        x, y, z = (
            slice(int(index.min()), int(index.max()) + 1)
            for index in np.unravel_index(hinges, self.hinges.shape)
        )
        return (x, y, z)

    def over_box(self, weights: NDArray[np.intp], rows: NDArray[np.float64], box: Box) -> NDArray[np.float64]:
        """Returns rows (k, R) of some weights (k,) laid out over a box that holds them, zero elsewhere."""
        hinges = np.flatnonzero(self.weight_of_hinge >= 0)[weights]
        tensor = np.zeros((*(part.stop - part.start for part in box), rows.shape[1]))
        indices = np.unravel_index(hinges, self.hinges.shape)
        tensor[tuple(index - part.start for index, part in zip(indices, box, strict=True))] = rows
        return tensor

    def over_hinges(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns values of the weights, shape (M,) or (M, R), laid out over the lattice with zeros in the
        clearances.

        The shape is (n_x, n_y, n_z, R), R = 1 for one value per weight.
        """
        tensor = np.zeros((self.hinges.n_points, *values.reshape(len(values), -1).shape[1:]))
        tensor[self.weight_of_hinge >= 0] = values.reshape(len(values), -1)
        return tensor.reshape(*self.hinges.shape, -1)

    def along_axes(self, points_m: NDArray[np.float64], box: Box | None = None) -> AxisFeatures:
        """Returns the factors of the features of N points for the hinges of a box (all without a box)."""
        axes = (
            self.hinges.axes_m
            if box is None
            else [axis[part] for axis, part in zip(self.hinges.axes_m, box, strict=True)]
        )
        return self._factors((points_m[:, 0], points_m[:, 1], points_m[:, 2]), axes)

    def on_lattice(self, query: Lattice) -> AxisFeatures:
        """Returns the factors of the features of a lattice of points, one set of rows per axis."""
        return self._factors(query.axes_m, self.hinges.axes_m)

    def _factors(
        self, coordinates: Sequence[NDArray[np.float64]], axes: Sequence[NDArray[np.float64]]
    ) -> AxisFeatures:
        # k_d(x_d, h_d) = exp(-gamma (x_d - h_d)^2)
        x, y, z = (
            np.exp(-self.gamma_per_m2 * (of_points[:, None] - of_hinges) ** 2)
            for of_points, of_hinges in zip(coordinates, axes, strict=True)
        )
        return AxisFeatures(x, y, z)


def box_within(lattice: Lattice, low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> Box:
    """Returns the box of lattice indices whose points lie between two corners (it may be empty)."""
    x, y, z = (
        slice(int(np.searchsorted(axis, low_m[d], "left")), int(np.searchsorted(axis, high_m[d], "right")))
        for d, axis in enumerate(lattice.axes_m)
    )
    return (x, y, z)


def box_indices(box: Box, shape: tuple[int, int, int]) -> NDArray[np.intp]:
    """Returns the flat indices, in C order, of the points of a box in a lattice of the given shape."""
    x, y, z = (np.arange(part.start, part.stop) for part in box)
    return ((x[:, None, None] * shape[1] + y[None, :, None]) * shape[2] + z).ravel()


def outer_features(factors: AxisFeatures) -> NDArray[np.float64]:
    """Returns the features of N points, shape (N, n_x n_y n_z), from their factors along the axes (eq. 1)."""
    xy = factors.x[:, :, None] * factors.y[:, None, :]
    features = xy[:, :, :, None] * factors.z[:, None, None, :]
    return features.reshape(len(features), int(np.prod(features.shape[1:])))


def feature_products(factors: AxisFeatures, others: AxisFeatures) -> NDArray[np.float64]:
    """Returns the products phi(x_n) . phi(x'_m) over the hinges of one box, shape (N, M), without forming a
    feature.
    """
    products = factors.x @ others.x.T
    products *= factors.y @ others.y.T
    products *= factors.z @ others.z.T
    return products


def contract(factors: AxisFeatures, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns weighted sums of the features on a lattice of query points.

    Args:
        factors: Factors of the features along each axis of the query lattice, shapes (q_d, n_d).
        weights: Weights of the hinges of a box, shape (n_x, n_y, n_z, R): R sets of weights at once.

    Returns:
        The sums, shape (q_x, q_y, q_z, R).
    """
    nx, ny, nz, n_sets = weights.shape
    qx, qy, qz = (len(factor) for factor in factors)
    sums = (factors.x @ weights.reshape(nx, -1)).reshape(qx, ny, nz * n_sets)
    sums = np.matmul(factors.y, sums).reshape(qx * qy, nz, n_sets)
    return np.matmul(factors.z, sums).reshape(qx, qy, qz, n_sets)

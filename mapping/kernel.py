"""The features of a Hilbert map: the squared-exponential kernel (eq. 1 of the paper) on a lattice of hinges.

    phi(x) = (k(x, h_1), ..., k(x, h_M)),   k(x, h) = exp(-gamma |x - h|^2)   (eq. 1)

The paper writes Psi for phi and x~_j for the hinge h_j. Phi has the features of several points as its rows. The paper
gives gamma per squared unit of length without naming the unit; it is taken to be 30 mm here, and gamma is in 1/m^2.

The kernel is a product over the axes and the hinges lie on a lattice, so a row of features is an outer product of
three short vectors, and a weighted sum of features on a second lattice is three small matrix products (a Kronecker
product that is never formed). Features below a cutoff may be taken as zero, which makes everything local; the paper
keeps them all.
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
    """The features phi of eq. 1, centred on the points of a lattice, some of which may be left out."""

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
        """The features of the hinges that a mask keeps.

        Args:
            hinges: The lattice, evenly spaced along each axis.
            gamma_per_m2: gamma of eq. 1 [1/m^2].
            hinge_mask: Which hinges are kept, shape (hinges.n_points,); all if None.

        Raises:
            ValueError: If the mask does not fit the lattice or keeps nothing.
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
        """The distance [m] beyond which features are smaller than a cutoff (infinite for 0)."""
        return float(np.sqrt(-np.log(cutoff) / self.gamma_per_m2)) if cutoff > 0 else np.inf

    def box_around(self, points_m: NDArray[np.float64], cutoff: float) -> Box:
        """The box of hinges within reach of the bounding box of points [m], shape (N, 3)."""
        reach_m = self.reach_m(cutoff)
        return box_within(self.hinges, points_m.min(axis=0) - reach_m, points_m.max(axis=0) + reach_m)

    def weights_in(self, box: Box) -> NDArray[np.intp]:
        """The index of the weight of each hinge of a box, -1 where there is none, in C order."""
        return self.weight_of_hinge[box_indices(box, self.hinges.shape)]

    def box_of(self, weights: NDArray[np.intp]) -> Box:
        """The smallest box of hinges that holds those of some weights, shape (k,), k > 0."""
        hinges = np.flatnonzero(self.weight_of_hinge >= 0)[weights]
        x, y, z = (
            slice(int(index.min()), int(index.max()) + 1)
            for index in np.unravel_index(hinges, self.hinges.shape)
        )
        return (x, y, z)

    def over_box(
        self, weights: NDArray[np.intp], rows: NDArray[np.floating], box: Box
    ) -> NDArray[np.floating]:
        """Rows (k, R) of some weights (k,) laid out over a box that holds these, zero elsewhere."""
        hinges = np.flatnonzero(self.weight_of_hinge >= 0)[weights]
        tensor = np.zeros((*(part.stop - part.start for part in box), rows.shape[1]), dtype=rows.dtype)
        indices = np.unravel_index(hinges, self.hinges.shape)
        tensor[tuple(index - part.start for index, part in zip(indices, box, strict=True))] = rows
        return tensor

    def over_hinges(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values of the weights laid out over the lattice, zero where a hinge is left out, shape (n_x, n_y, n_z, R).

        Args:
            values: One value or R values per weight, shape (M,) or (M, R); R is 1 for one.
        """
        tensor = np.zeros((self.hinges.n_points, *values.reshape(len(values), -1).shape[1:]))
        tensor[self.weight_of_hinge >= 0] = values.reshape(len(values), -1)
        return tensor.reshape(*self.hinges.shape, -1)

    def along_axes(self, points_m: NDArray[np.float64], box: Box | None = None) -> AxisFeatures:
        """The factors of the features of N points [m], shape (N, 3), for the hinges of a box (for all without one)."""
        axes = (
            self.hinges.axes_m
            if box is None
            else [axis[part] for axis, part in zip(self.hinges.axes_m, box, strict=True)]
        )
        return self._factors((points_m[:, 0], points_m[:, 1], points_m[:, 2]), axes)

    def on_lattice(self, query: Lattice) -> AxisFeatures:
        """The factors of the features of a lattice of points, one set of rows per axis."""
        return self._factors(query.axes_m, self.hinges.axes_m)

    def _factors(
        self, coordinates: Sequence[NDArray[np.float64]], axes: Sequence[NDArray[np.float64]]
    ) -> AxisFeatures:
        x, y, z = (
            squared_exponential(of_points, of_hinges, self.gamma_per_m2)
            for of_points, of_hinges in zip(coordinates, axes, strict=True)
        )
        return AxisFeatures(x, y, z)


def squared_exponential(
    coordinates_m: NDArray[np.float64], hinge_coordinates_m: NDArray[np.float64], gamma_per_m2: float
) -> NDArray[np.float64]:
    """The kernel's factor along one axis, k_d(x, h) = exp(-gamma (x_d - h_d)^2), shape (N, n).

    The kernel of eq. 1 is the product of its factors along the three axes, which `outer_features` forms:

        k(x, h) = exp(-gamma |x - h|^2) = k_x(x, h) k_y(x, h) k_z(x, h)   (eq. 1)

    Args:
        coordinates_m: Coordinates of N points along the axis [m], shape (N,).
        hinge_coordinates_m: Coordinates of n hinges along the axis [m], shape (n,).
        gamma_per_m2: gamma [1/m^2].
    """
    return np.exp(-gamma_per_m2 * (coordinates_m[:, None] - hinge_coordinates_m) ** 2)


def box_within(lattice: Lattice, low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> Box:
    """The box of lattice indices whose points lie between two corners [m], shape (3,); it may be empty."""
    x, y, z = (
        slice(int(np.searchsorted(axis, low_m[d], "left")), int(np.searchsorted(axis, high_m[d], "right")))
        for d, axis in enumerate(lattice.axes_m)
    )
    return (x, y, z)


def box_indices(box: Box, shape: tuple[int, int, int]) -> NDArray[np.intp]:
    """The flat indices, in C order, of the points of a box in a lattice of the given shape."""
    x, y, z = (np.arange(part.start, part.stop) for part in box)
    return ((x[:, None, None] * shape[1] + y[None, :, None]) * shape[2] + z).ravel()


def outer_features(factors: AxisFeatures) -> NDArray[np.float64]:
    """The features phi(x) of N points (eq. 1), shape (N, n_x n_y n_z), as products of their factors along the axes."""
    xy = factors.x[:, :, None] * factors.y[:, None, :]
    features = xy[:, :, :, None] * factors.z[:, None, None, :]
    return features.reshape(len(features), int(np.prod(features.shape[1:])))


def feature_products(factors: AxisFeatures, others: AxisFeatures) -> NDArray[np.float64]:
    """The products phi(x_n) . phi(x'_m) over the hinges of one box, shape (N, N'), without forming a feature."""
    products = factors.x @ others.x.T
    products *= factors.y @ others.y.T
    products *= factors.z @ others.z.T
    return products


def contract(factors: AxisFeatures, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted sums of the features, phi(x) . w, on a lattice of query points, shape (q_x, q_y, q_z, R).

    Args:
        factors: Factors of the features along each axis of the query lattice, shapes (q_d, n_d).
        weights: Weights of the hinges of a box, shape (n_x, n_y, n_z, R): R sets of weights at once.
    """
    nx, ny, nz, n_sets = weights.shape
    qx, qy, qz = (len(factor) for factor in factors)
    sums = (factors.x @ weights.reshape(nx, -1)).reshape(qx, ny, nz * n_sets)
    sums = np.matmul(factors.y, sums).reshape(qx * qy, nz, n_sets)
    return np.matmul(factors.z, sums).reshape(qx, qy, qz, n_sets)

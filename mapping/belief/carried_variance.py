"""The variance of the latent on one lattice, carried along with the readings.

It falls where the covariance of the weights falls, at a cost that depends on the cone and not on how much is known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernel import AxisFeatures, HingeFeatures, box_within, contract
from ..lattice import Lattice


class CarriedVariance:
    """The variance at the points of a lattice; a reading lowers it by |phi(x) G|^2, but only near the reading."""

    def __init__(
        self,
        features: HingeFeatures,
        query: Lattice,
        weight_variance: float,
        *,
        query_mask: NDArray[np.bool_] | None = None,
        cutoff: float,
    ) -> None:
        """Starts at the prior.

        Args:
            features: The features phi.
            query: The lattice.
            weight_variance: Variance of each weight before any reading.
            query_mask: At which of its points the variance is carried, shape (query.n_points,); at all if None.
                What stands at the others has no meaning.
            cutoff: Features smaller than this are left out.
        """
        self._features = features
        self._cutoff = cutoff
        self.query = query
        x, y, z = (factor**2 for factor in features.on_lattice(query))
        prior = features.over_hinges(np.full(features.n_weights, weight_variance))
        self.values = contract(AxisFeatures(x, y, z), prior)[..., 0]
        keep = np.ones(query.n_points, dtype=bool) if query_mask is None else query_mask
        self._kept = [_bounds(plane) for plane in keep.reshape(query.shape)]

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.float64], *, sign: float = 1.0) -> None:
        """Takes off the variance of sign G G^T.

        Args:
            weights: Weights to which the rows of G belong, ascending, shape (k,).
            G: Rows, shape (k, s).
            sign: 1 where the covariance falls, -1 where it rises.
        """
        box = self._features.box_of(weights)
        tensor = self._features.over_box(weights, G, box)
        reach_m = self._features.reach_m(self._cutoff)
        axes_m = self._features.hinges.axes_m
        ends = [axis[[part.start, part.stop - 1]] for axis, part in zip(axes_m, box, strict=True)]
        low_m, high_m = np.transpose(ends) + np.array([[-reach_m], [reach_m]])
        near = box_within(self.query, low_m, high_m)
        factors = self._features.on_lattice(self.query)
        x, y, z = (factor[:, part] for factor, part in zip(factors, box, strict=True))
        # One plane of x at a time keeps the sums in the cache.
        for row in range(near[0].start, near[0].stop):
            in_y, in_z = (_common(part, kept) for part, kept in zip(near[1:], self._kept[row], strict=True))
            sums = contract(AxisFeatures(x[row : row + 1], y[in_y], z[in_z]), tensor)
            self.values[row, in_y, in_z] -= sign * np.einsum("xyzr,xyzr->yz", sums, sums)


def _bounds(plane: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The ranges along y and z that hold all true points of a plane."""
    ranges = []
    for axis in (1, 0):
        hit = np.flatnonzero(plane.any(axis=axis))
        ranges.append(slice(int(hit[0]), int(hit[-1]) + 1) if hit.size else slice(0, 0))
    return ranges[0], ranges[1]


def _common(first: slice, second: slice) -> slice:
    start = max(first.start, second.start)
    return slice(start, max(start, min(first.stop, second.stop)))

"""The variance of the latent on one lattice, carried along with the readings.

It falls where the covariance of the weights falls, at a cost that depends on the cone and not on how much is known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernel import AxisFeatures, HingeFeatures, box_within, contract
from ..lattice import Lattice

# Planes of points along x at a time: enough for a matrix product, few enough for the cache.
_PLANES = 8


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
        precision: type[np.floating] = np.float64,
    ) -> None:
        """Starts at the prior.

        Args:
            features: The features phi.
            query: The lattice.
            weight_variance: Variance of each weight before any reading.
            query_mask: At which of its points the variance is carried, shape (query.n_points,); at all if None.
                What stands at the others has no meaning.
            cutoff: Features smaller than this are left out.
            precision: Type in which what a reading takes off is summed; the variance itself is kept in double.
        """
        self._features = features
        self._cutoff, self._precision = cutoff, precision
        self.query = query
        x, y, z = (factor**2 for factor in features.on_lattice(query))
        prior = features.over_hinges(np.full(features.n_weights, weight_variance))
        self.values = contract(AxisFeatures(x, y, z), prior)[..., 0]
        keep = np.ones(query.n_points, dtype=bool) if query_mask is None else query_mask
        self._kept = [_bounds(plane) for plane in keep.reshape(query.shape)]

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.floating], *, sign: float = 1.0) -> None:
        """Takes off the variance of sign G G^T.

        Args:
            weights: Weights to which the rows of G belong, ascending, shape (k,).
            G: Rows, shape (k, s).
            sign: 1 where the covariance falls, -1 where it rises.
        """
        box = self._features.box_of(weights)
        tensor = self._features.over_box(weights, G, box).astype(self._precision, copy=False)
        reach_m = self._features.reach_m(self._cutoff)
        axes_m = self._features.hinges.axes_m
        ends = [axis[[part.start, part.stop - 1]] for axis, part in zip(axes_m, box, strict=True)]
        low_m, high_m = np.transpose(ends) + np.array([[-reach_m], [reach_m]])
        near = box_within(self.query, low_m, high_m)
        factors = self._features.on_lattice(self.query)
        x, y, z = (factor[:, part].astype(self._precision) for factor, part in zip(factors, box, strict=True))
        for start in range(near[0].start, near[0].stop, _PLANES):
            rows = range(start, min(start + _PLANES, near[0].stop))
            planes = (x[rows.start : rows.stop] @ tensor.reshape(len(tensor), -1)).reshape(
                -1, *tensor.shape[1:]
            )
            for row, plane in zip(rows, planes, strict=True):
                in_y, in_z = (
                    _common(part, kept) for part, kept in zip(near[1:], self._kept[row], strict=True)
                )
                sums = _over_plane(y[in_y], z[in_z], plane)
                self.values[row, in_y, in_z] -= sign * np.einsum("yzr,yzr->yz", sums, sums)


def _over_plane(
    y: NDArray[np.floating], z: NDArray[np.floating], plane: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Sums over a plane of hinges (n_y, n_z, R) at a lattice of points, shape (q_y, q_z, R)."""
    along_z = np.matmul(z, plane).reshape(len(plane), len(z) * plane.shape[2])
    return (y @ along_z).reshape(len(y), len(z), plane.shape[2])


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

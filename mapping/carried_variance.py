"""The variance of the latent on one lattice, carried along: for beliefs whose readings touch very many
weights.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kernel import AxisFeatures, HingeFeatures, box_within, contract, outer_features
from .lattice import Lattice
from .tiled import TiledCovariance


class CarriedVariance:
    """Variance at the points of a query lattice; after a reading it falls by |phi(x) G|^2, near the reading
    alone.
    """

    def __init__(
        self, features: HingeFeatures, covariance: TiledCovariance, query: Lattice | None, *, cutoff: float
    ) -> None:
        """Starts at the prior variance; features below `cutoff` are left out."""
        self._features = features
        self._covariance = covariance
        self._query = query
        self._cutoff = cutoff
        self._kept = np.flatnonzero(features.weight_of_hinge >= 0)
        self.coefficients = np.zeros((0, 0, 0)) if query is None else self._prior(query)

    def lower(self, weights: NDArray[np.intp], G: NDArray[np.float64], *, sign: float = 1.0) -> None:
        """Takes the variance of sign G G^T off, for G the rows (k, s) of some weights (k,)."""
        if self._query is None or G.size == 0:
            return
        hinges = self._features.hinges
        indices = np.unravel_index(self._kept[weights], hinges.shape)
        box = tuple(slice(int(index.min()), int(index.max()) + 1) for index in indices)
        tensor = np.zeros((*(part.stop - part.start for part in box), G.shape[1]))
        tensor[tuple(index - part.start for index, part in zip(indices, box, strict=True))] = G
        reach_m = self._features.reach_m(self._cutoff)
        ends = [axis[[part.start, part.stop - 1]] for axis, part in zip(hinges.axes_m, box, strict=True)]
        low_m, high_m = np.transpose(ends) + np.array([[-reach_m], [reach_m]])
        near = box_within(self._query, low_m, high_m)
        factors = self._features.on_lattice(self._query)
        x, y, z = (factor[rows, part] for factor, rows, part in zip(factors, near, box, strict=True))
        # One plane of x at a time keeps the sums in the cache.
        for i, row in enumerate(range(near[0].start, near[0].stop)):
            sums = contract(AxisFeatures(x[i : i + 1], y, z), tensor)
            self.coefficients[row, near[1], near[2]] -= sign * np.einsum("xyzr,xyzr->yz", sums, sums)

    def on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """Returns the variance at all points of a lattice: at once for the one that is carried, else point
        by point.
        """
        if query is self._query:
            return self.coefficients.ravel()
        return self.at(query.points_m(), self._cutoff)

    def at(self, points_m: NDArray[np.float64], cutoff: float) -> NDArray[np.float64]:
        """Returns the variance phi Sigma phi^T at points that lie close together, shape (N, 3)."""
        box = self._features.box_around(points_m, cutoff)
        weights = self._features.weights_in(box)
        Phi = outer_features(self._features.along_axes(points_m, box))[:, weights >= 0]
        weights = weights[weights >= 0]
        columns, cross = self._covariance.cross(Phi, weights)
        return np.einsum("nk,nk->n", cross[:, np.searchsorted(columns, weights)], Phi)

    def _prior(self, query: Lattice) -> NDArray[np.float64]:
        x, y, z = (factor**2 for factor in self._features.on_lattice(query))
        prior = self._covariance.prior_variances()
        return contract(AxisFeatures(x, y, z), self._features.over_hinges(prior))[..., 0]

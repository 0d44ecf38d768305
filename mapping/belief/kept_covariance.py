"""What the dense and the tiled covariance have in common: quadratic forms, and the variance that is carried along."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from ..kernel import HingeFeatures, outer_features
from ..lattice import Lattice
from .carried_variance import CarriedVariance


class KeptCovariance(ABC):
    """Sigma, however it is kept, and its variance at the points of a query lattice where one is carried."""

    def __init__(self, features: HingeFeatures, carried: CarriedVariance | None) -> None:
        """Keep the features and the variance that is to fall along with the covariance."""
        self._features = features
        self._carried = carried

    @abstractmethod
    def among(self, C: NDArray[np.float64], weights: NDArray[np.intp]) -> NDArray[np.float64]:
        """Returns C Sigma among some weights (k,) alone, shape (r, k), for C of shape (r, k)."""

    def inner(self, C: NDArray[np.float64], weights: NDArray[np.intp]) -> NDArray[np.float64]:
        """Returns C Sigma C^T among some weights (k,), for C of shape (r, k)."""
        return self.among(C, weights) @ C.T

    def variance_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """Returns the variance of the latent on the lattice that it is carried on, true where its mask keeps a point.

        Raises:
            ValueError: If it is carried on another lattice or on none.
        """
        if self._carried is None or query is not self._carried.query:
            raise ValueError("the variance is carried on the query lattice alone that the map was made with")
        return self._carried.values.ravel()

    def variance_at(self, points_m: NDArray[np.float64], cutoff: float) -> NDArray[np.float64]:
        """Returns the variance phi Sigma phi^T at points that lie close together, shape (N, 3)."""
        box = self._features.box_around(points_m, cutoff)
        weights = self._features.weights_in(box)
        Phi = outer_features(self._features.along_axes(points_m, box))[:, weights >= 0]
        return np.einsum("nk,nk->n", self.among(Phi, weights[weights >= 0]), Phi)

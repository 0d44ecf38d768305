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
        """Takes the features, and the variance that is to fall along with the covariance; None for none."""
        self._features = features
        self._carried = carried

    @abstractmethod
    def among(self, C: NDArray[np.float64], weights: NDArray[np.intp]) -> NDArray[np.float64]:
        """C Sigma with nothing but the covariances among some weights (k,), shape (r, k), for C of shape (r, k)."""

    @abstractmethod
    def cross(
        self, C: NDArray[np.float64], weights: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.floating]]:
        """The weights that may covary with some weights, and C Sigma for these.

        Args:
            C: Rows over some weights, shape (r, k).
            weights: Those weights, ascending, shape (k,).

        Returns:
            The weights that may covary with them, ascending, shape (m,), and C Sigma, shape (r, m).
        """

    @abstractmethod
    def lower(self, weights: NDArray[np.intp], G: NDArray[np.floating], *, sign: float = 1.0) -> None:
        """Takes sign G G^T off the covariance of some weights, as far as it is kept.

        Args:
            weights: The weights, ascending, shape (k,).
            G: Their rows, shape (k, s).
            sign: 1 where the covariance falls, -1 where it rises.
        """

    @abstractmethod
    def settle(self) -> None:
        """Does what `lower` has put off, for whoever has time now and none when the next reading comes."""

    def variance_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """The variance of the latent on the lattice that it is carried on, shape (query.n_points,).

        It holds where the lattice's mask keeps a point; what stands at the other points has no meaning.

        Raises:
            ValueError: If it is carried on another lattice or on none.
        """
        if self._carried is None or query is not self._carried.query:
            raise ValueError("the variance is carried only on the query lattice that the map was made with")
        return self._carried.values.ravel()

    def variance_at(self, points_m: NDArray[np.float64], cutoff: float) -> NDArray[np.float64]:
        """The variance phi Sigma phi^T at points that lie close together, shape (N,).

        Args:
            points_m: The points [m], shape (N, 3).
            cutoff: Features smaller than this are left out.
        """
        box = self._features.box_around(points_m, cutoff)
        weights = self._features.weights_in(box)
        Phi = outer_features(self._features.along_axes(points_m, box))[:, weights >= 0]
        return np.einsum("nk,nk->n", self.among(Phi, weights[weights >= 0]), Phi)

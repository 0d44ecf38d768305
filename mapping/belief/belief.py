"""What every form of the belief over the weights offers to the map."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernel import HingeFeatures, contract, outer_features
from ..lattice import Lattice
from ..likelihood import Evidence
from ..settings import MapSettings

# Query points are taken together in cubes of this many hinge spacings: few cubes, each with few features.
_CUBE_SPACINGS = 3
# Features that the mean at a point may leave out, as a multiple of `MapSettings.tolerance`.
_MEAN_CUTOFF = 0.1


class Moments(NamedTuple):
    """Mean and variance of phi(x) . w at N points, the latent without its offset."""

    mean: NDArray[np.float64]
    variance: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class UpdateReport:
    """What a reading did to the belief."""

    n_points: int
    """Points in the reading."""
    n_occupied: int
    """How many of them were labelled occupied."""
    rank: int
    """Directions of weight space in which the reading said something."""
    n_weights_touched: int
    """Weights whose variance it changed."""
    curvature: NDArray[np.float64]
    """lambda of the bound at each point, shape (n_points,): half the precision with which it was observed."""


class LearningReport(NamedTuple):
    """What a belief says of a reading that it took in; `UpdateReport` has the meaning of each field."""

    rank: int
    n_weights_touched: int
    curvature: NDArray[np.float64]


class Belief(ABC):
    """Gaussian belief over the weights of the features; readings change it in place."""

    mean: NDArray[np.float64]
    """mu, shape (M,)."""
    _features: HingeFeatures
    _settings: MapSettings

    @abstractmethod
    def learn(
        self, points_m: NDArray[np.float64], offset: NDArray[np.float64], evidence: Evidence
    ) -> LearningReport:
        """Takes in a reading.

        Args:
            points_m: Sensed points [m], shape (n, 3), n of at least 1.
            offset: The latent's offset b at each of them, shape (n,).
            evidence: What the n labels say of their points.
        """

    @abstractmethod
    def revise(self) -> float:
        """Fits every reading so far anew.

        Returns:
            The largest change of the latent's mean at a sensed point.

        Raises:
            ValueError: If the form keeps no readings.
        """

    def lay(self, points_m: Sequence[NDArray[np.float64]], offsets: Sequence[NDArray[np.float64]]) -> bool:
        """Has the readings that it holds lie elsewhere, each label saying of its new place what it said of the old.

        Args:
            points_m: Where the points of each now lie [m], shapes (n, 3).
            offsets: The latent's offset b there, shapes (n,).

        Returns:
            Whether it did; a form that does not keep what it has learnt of each label cannot.
        """
        return False

    @abstractmethod
    def settle(self) -> None:
        """Does what taking in a reading has put off; nothing that can be asked depends on it."""

    @abstractmethod
    def carry_samples(self, n_samples: int, rng: np.random.Generator) -> None:
        """Draws weights from the belief and moves them with every later reading.

        Args:
            n_samples: Number of draws, S.
            rng: Source of the draws, now and at every later reading.

        Raises:
            ValueError: If the form cannot draw any more.
        """

    @abstractmethod
    def state(self) -> dict[str, NDArray]:
        """The arrays that make up the belief; carried samples are not among them."""

    @abstractmethod
    def restore(self, state: Mapping[str, NDArray]) -> None:
        """Takes over the arrays of another belief with the same settings and hinges.

        Raises:
            KeyError: If an array is missing.
            ValueError: If an array is missing, of another shape, not finite, or not a covariance.
        """

    @property
    @abstractmethod
    def samples(self) -> NDArray[np.float64]:
        """The carried draws of the weights, shape (M, S).

        Raises:
            ValueError: If none are carried.
        """

    @abstractmethod
    def variance_on_lattice(self, query: Lattice) -> NDArray[np.float64]:
        """The variance phi(x) Sigma phi(x)^T at all points of a lattice, shape (query.n_points,)."""

    @abstractmethod
    def variance_near(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The variance phi(x) Sigma phi(x)^T at points [m] that lie close together, shape (N, 3)."""

    def lattice_moments(self, query: Lattice) -> Moments:
        """The moments at all points of a lattice."""
        mean = contract(self._features.on_lattice(query), self._features.over_hinges(self.mean))
        return Moments(mean.ravel(), self.variance_on_lattice(query))

    def lattice_samples(self, query: Lattice) -> NDArray[np.float64]:
        """The values phi(x) . w of the carried draws at all points of a lattice, shape (query.n_points, S)."""
        draws = contract(self._features.on_lattice(query), self._features.over_hinges(self.samples))
        return draws.reshape(query.n_points, -1)

    def moments(self, points_m: NDArray[np.float64]) -> Moments:
        """The moments at any points [m], shape (N, 3), cube by cube, so that only what is within reach takes part."""
        mean, variance = np.zeros(len(points_m)), np.zeros(len(points_m))
        weights = self._features.over_hinges(self.mean)
        for part in _cubes(points_m, _CUBE_SPACINGS * self._features.spacing_m):
            near = points_m[part]
            box = self._features.box_around(near, _MEAN_CUTOFF * self._settings.tolerance)
            Phi = outer_features(self._features.along_axes(near, box))
            mean[part] = Phi @ weights[box].ravel()
            variance[part] = self.variance_near(near)
        return Moments(mean, variance)


def _cubes(points_m: NDArray[np.float64], width_m: float) -> list[NDArray[np.intp]]:
    """The indices of the points that share a cube of a given width, cube by cube."""
    cubes = np.floor((points_m - points_m.min(axis=0)) / width_m).astype(np.intp)
    _, cube_of_point = np.unique(cubes, axis=0, return_inverse=True)
    order = np.argsort(cube_of_point, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(cube_of_point[order])) + 1)

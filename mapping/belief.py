"""What every form of the belief over the weights offers to the map."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Moments(NamedTuple):
    """Mean and variance of phi(x) . w at N points, the latent without its offset."""

    mean: NDArray[np.float64]
    variance: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
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


class Belief(ABC):
    """Gaussian belief over the weights of the features; readings change it in place."""

    mean: NDArray[np.float64]
    """mu, shape (M,)."""

    @abstractmethod
    def learn(
        self, points_m: NDArray[np.float64], offset: NDArray[np.float64], is_occupied: NDArray[np.float64]
    ) -> UpdateReport:
        """Takes in a reading: points [m] (n, 3), the latent's offset there (n,) and labels (n,)."""

    @abstractmethod
    def moments(self, points_m: NDArray[np.float64]) -> Moments:
        """Returns the moments at any points [m], shape (N, 3)."""

    @abstractmethod
    def lattice_moments(self) -> Moments:
        """Returns the moments at all points of the query lattice."""

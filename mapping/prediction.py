"""What a map says of points: the Gaussian latent and the probability of occupancy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .likelihood import moderation, occupancy_probability


@dataclass(frozen=True, eq=False)
class Prediction:
    """Belief about N points, each marginally."""

    latent_mean: NDArray[np.float64]
    """Mean of the latent f(x) = b + phi(x) . w, shape (N,)."""
    latent_variance: NDArray[np.float64]
    """Variance of the latent, shape (N,), never negative."""

    @property
    def latent_std(self) -> NDArray[np.float64]:
        """Standard deviation of the latent, shape (N,)."""
        return np.sqrt(self.latent_variance)

    @property
    def score(self) -> NDArray[np.float64]:
        """kappa(v) times the latent's mean, shape (N,): ranks as the probability does, but never saturates
        into ties.
        """
        return moderation(self.latent_variance) * self.latent_mean

    @property
    def probability(self) -> NDArray[np.float64]:
        """Probability of occupancy, P(y = 1 | x), shape (N,)."""
        return occupancy_probability(self.latent_mean, self.latent_variance)

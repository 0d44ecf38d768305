"""What a map says of points: the Gaussian latent and the probability of occupancy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logit

from .likelihood import moderation, occupancy_probability

LEAST_PROBABILITY = 1e-12
"""Probabilities nearer to 0 or 1 than this count as this far from them. A point of which a map was sure, and wrong,
then costs 28 nats in the log loss and not infinitely many; float64 tells 1 - 1e-12 from 1 with four digits to spare."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Belief about N points, each marginally."""

    latent_mean: NDArray[np.float64]
    """Mean of the latent f(x) = b(x) + phi(x) . w, shape (N,)."""
    latent_variance: NDArray[np.float64]
    """Variance of the latent, shape (N,), never negative."""

    def __post_init__(self) -> None:
        """Checks that both are given for the same points.

        Raises:
            ValueError: If the shapes differ or are not (N,).
        """
        mean, variance = np.shape(self.latent_mean), np.shape(self.latent_variance)
        if len(mean) != 1 or mean != variance:
            raise ValueError(
                f"a prediction needs one latent_mean and one latent_variance per point, shapes (N,), not {mean} and "
                f"{variance}"
            )

    @classmethod
    def from_probability(cls, probability: ArrayLike) -> Prediction:
        """The prediction of a map that has no latent: mean logit(p) and no variance, so that `probability` is p again.

        Probabilities are clipped to 1e-12 .. 1 - 1e-12 (`LEAST_PROBABILITY`), where the logit is finite. Without a
        variance expected improvement has nothing to explore: its planner goes where p is highest.

        Args:
            probability: Probability of occupancy at each point, shape (N,), between 0 and 1.

        Raises:
            ValueError: If the shape is not (N,), or a value is not between 0 and 1.
        """
        values = np.asarray(probability, dtype=np.float64)
        if values.ndim != 1:
            raise ValueError(f"probability must have shape (N,), not {values.shape}")
        is_wrong = ~((values >= 0.0) & (values <= 1.0))
        if is_wrong.any():
            first = int(np.argmax(is_wrong))
            raise ValueError(f"probability must lie between 0 and 1, but point {first} has {values[first]}")
        mean = logit(np.clip(values, LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY))
        return cls(mean, np.zeros_like(mean))

    @property
    def latent_std(self) -> NDArray[np.float64]:
        """Standard deviation of the latent, shape (N,)."""
        return np.sqrt(self.latent_variance)

    @property
    def score(self) -> NDArray[np.float64]:
        """Moderated mean kappa(v) m, shape (N,): the logit of the probability, which never saturates into ties."""
        return moderation(self.latent_variance) * self.latent_mean

    @property
    def probability(self) -> NDArray[np.float64]:
        """Probability of occupancy, P(y = 1 | x) = sigma(kappa(v) m), shape (N,)."""
        return occupancy_probability(self.latent_mean, self.latent_variance)

"""Draws of whole maps, carried along: each reading moves a draw of the prior to a draw of the posterior."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .variational import ReadingPosterior


class WeightSamples:
    """Draws of the weights about their mean, moved in place by each reading.

    A draw w has the reading's coordinates z = R^-1 C (w - mu). What does not depend on z stays as it is and
    z becomes a
    draw z' of its posterior, so w' = w + Y (z' - z): no factor of the covariance is needed (Matheron's rule).
    """

    def __init__(self, deviations: NDArray[np.float64], rng: np.random.Generator) -> None:
        """Takes draws about the mean, shape (M, S), and the generator of all later noise."""
        self.deviations = deviations
        self._rng = rng

    def learn(
        self,
        near: NDArray[np.intp],
        to_reading: NDArray[np.float64],
        weights: NDArray[np.intp],
        from_reading: NDArray[np.float64],
        reading: ReadingPosterior,
    ) -> None:
        """Moves the draws.

        Args:
            near: Weights that the reading's features touch, shape (h,).
            to_reading: R^-1 C, shape (r, h).
            weights: Weights that covary with them, shape (m,).
            from_reading: Y^T, shape (r, m).
            reading: The reading's posterior.
        """
        self.deviations[weights] += from_reading.T @ reading.move(
            to_reading @ self.deviations[near], self._rng
        )

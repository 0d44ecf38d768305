"""Draws of whole maps, carried along: each reading moves a draw of the prior to a draw of the posterior."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .coordinates import ReadingCoordinates
from .dense_covariance import DenseCovariance
from .variational import ReadingChange, ReadingPosterior


class WeightSamples:
    """Draws of the weights about their mean, moved in place by each reading.

    A draw w has the coordinates z in a reading. What does not depend on z stays as it is, and z becomes a draw z' of
    its posterior, so w' = w + Y (z' - z): no factor of the covariance is needed (Matheron's rule).
    """

    def __init__(self, deviations: NDArray[np.float64], rng: np.random.Generator) -> None:
        """Takes draws and the source of all later noise.

        Args:
            deviations: Draws about the mean, shape (M, S).
            rng: The source.
        """
        self.deviations = deviations
        self._rng = rng

    def drawn_anew(self, covariance: DenseCovariance) -> WeightSamples:
        """As many draws of another belief, which have nothing to do with these.

        Args:
            covariance: Its covariance.
        """
        return WeightSamples(covariance.draw(self.deviations.shape[1], self._rng), self._rng)

    def learn(self, coordinates: ReadingCoordinates, reading: ReadingPosterior) -> NDArray[np.float64]:
        """The change z' - z of each draw for a new reading, shape (r, S)."""
        return reading.move(coordinates.to_reading(self.deviations), self._rng)

    def revise(self, coordinates: ReadingCoordinates, change: ReadingChange) -> NDArray[np.float64]:
        """The change z' - z of each draw when an earlier reading is fitted again, shape (r, S)."""
        return change.move(coordinates.to_reading(self.deviations))

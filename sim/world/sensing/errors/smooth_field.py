"""Smooth random fields: how an outline strays from place to place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_N_WAVES = 64
"""Waves of a field; the sum is as good as normal, and its values cost little."""


@dataclass(frozen=True, eq=False)
class SmoothField:
    """A Gaussian random field of mean 0 and variance 1 with the covariance exp(-r^2 / (2 l^2)).

    It is a sum of waves, g(x) = sqrt(2 / K) sum_k cos(w_k . x + b_k), with wave vectors w_k from N(0, I / l^2) and
    phases b_k even in a circle (Rahimi and Recht 2007).
    """

    waves: NDArray[np.float64]
    """Wave vectors [1/m], shape (K, 3)."""
    phases: NDArray[np.float64]
    """Phases [rad], shape (K,)."""

    @classmethod
    def drawn(cls, length_m: float, rng: np.random.Generator) -> SmoothField:
        """A field of that length l [m]."""
        return cls(rng.standard_normal((_N_WAVES, 3)) / length_m, rng.uniform(0.0, 2.0 * np.pi, _N_WAVES))

    def at(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The field at points [m], shape (N, 3); result shape (N,)."""
        return np.sqrt(2.0 / _N_WAVES) * np.cos(points_m @ self.waves.T + self.phases).sum(axis=1)

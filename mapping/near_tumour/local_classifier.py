"""A Gaussian process classifier that asks, for each place, only the labels nearest to it.

The latent f has mean m_0 and the covariance s^2 exp(-r^2 / (2 l^2)), and a label says tumour with probability

    P(y = 1 | f) = p_+ + (1 - p_+ - p_-) sigma(f)

for a sensor that calls a share p_+ of free and misses a share p_- of tumour points; where labels err together, this
likelihood counts by a power w. Where labels may be wrong the
posterior has several modes, and the one that is found is that next to what the labels say. The posterior of
the latent at the neighbours of a place is taken to be Gaussian around its mode (Laplace's approximation; Rasmussen and
Williams 2006, section 3.4, with Fisher's information as the curvature), and gives that of the place itself. To ask near
neighbours alone is what makes Gaussian processes affordable for any number of data (Vecchia 1988; Datta et al. 2016).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from ..settings import DetailSettings

_BLOCK = 1024
"""Places that are handled at once, so that their matrices stay near the processor."""
_N_ROUNDS = 7
"""Rounds of Newton's method; from where it begins, this many bring the mode to a hundredth (tests/mapping)."""
_N_ROUNDS_IN_DOUBT = 30
"""The same where labels may be wrong."""
_SHARE_OF_A_STEP = 0.4
"""There, share of a round's step that is made: whole ones would go back and forth between modes."""
_FIRST_LATENT = (-8.0, 4.0)
"""Where the latent of a free and of a tumour label begins."""
_LARGEST_STEP = 4.0
"""How far a round may move a latent."""
_LEAST_SLOPE = 1e-6
"""Least slope of sigma, and least spread of a label, which keep a round finite where a label is all but certain."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The labels that answer for N places, k for each."""

    points_m: NDArray[np.float64]
    """Where they lie [m], shape (N, k, 3)."""
    is_tumour: NDArray[np.bool_]
    """What they say, shape (N, k)."""
    false_positive: NDArray[np.float64] | float
    """The rate at which free points are called tumour, of shape (N, k) or one for all."""
    false_negative: NDArray[np.float64] | float
    """The rate at which tumour points are called free, of shape (N, k) or one for all."""
    weight: NDArray[np.float64] | float
    """The power of each label's likelihood, of shape (N, k) or one for all."""

    def part(self, rows: slice) -> Neighbours:
        """The neighbours of some of the places."""
        per_label = (self.false_positive, self.false_negative, self.weight)
        rates = (each[rows] if isinstance(each, np.ndarray) else each for each in per_label)
        return Neighbours(self.points_m[rows], self.is_tumour[rows], *rates)


def classify(
    places_m: NDArray[np.float64], neighbours: Neighbours, settings: DetailSettings
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The latent's posterior mean and variance at places, each from its own neighbours, shapes (N,).

    Args:
        places_m: The places [m], shape (N, 3).
        neighbours: The labels that answer for each.
        settings: Gives the length, the prior mean and the prior variance.
    """
    mean, variance = np.empty(len(places_m)), np.empty(len(places_m))
    for first in range(0, len(places_m), _BLOCK):
        block = slice(first, first + _BLOCK)
        mean[block], variance[block] = _classify_block(places_m[block], neighbours.part(block), settings)
    return mean, variance


def _classify_block(
    places_m: NDArray[np.float64], neighbours: Neighbours, settings: DetailSettings
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    # Seen from their place, neighbours have coordinates of a few lengths, whose products lose no digits.
    offsets = ((neighbours.points_m - places_m[:, None]) / settings.length_m).astype(np.float32)
    squares = np.einsum("nij,nij->ni", offsets, offsets)
    between = squares[:, :, None] + squares[:, None] - 2.0 * (offsets @ offsets.transpose(0, 2, 1))
    prior = np.float32(settings.variance) * np.exp(-0.5 * np.maximum(between, 0.0))
    across = np.float32(settings.variance) * np.exp(-0.5 * squares)
    is_tumour = neighbours.is_tumour
    latent = np.where(is_tumour, np.float32(_FIRST_LATENT[1]), np.float32(_FIRST_LATENT[0]))
    diagonal = np.arange(prior.shape[1])
    false_positive = np.float32(neighbours.false_positive)
    kept = np.float32(1.0 - neighbours.false_positive - neighbours.false_negative)
    weight = np.float32(neighbours.weight)
    system, pull = prior, latent
    n_rounds, share = (_N_ROUNDS, 1.0) if np.all(kept == 1.0) else (_N_ROUNDS_IN_DOUBT, _SHARE_OF_A_STEP)
    for _ in range(n_rounds):
        chance = expit(latent)
        slope = kept * np.maximum(chance * (1.0 - chance), np.float32(_LEAST_SLOPE))
        said = false_positive + kept * chance
        spread = np.maximum(said * (1.0 - said), np.float32(_LEAST_SLOPE))
        target = latent + (is_tumour - said) / slope - np.float32(settings.prior_mean)
        system = prior.copy()
        system[:, diagonal, diagonal] += spread / (weight * slope**2)
        pull = np.linalg.solve(system, target[:, :, None])
        moved = np.float32(settings.prior_mean) + (prior @ pull)[:, :, 0]
        step = share * np.clip(moved - latent, -_LARGEST_STEP, _LARGEST_STEP)
        latent = latent + step.astype(np.float32)
    explained = np.linalg.solve(system, across[:, :, None])
    row = across[:, None]
    mean = settings.prior_mean + (row @ pull)[:, 0, 0].astype(np.float64)
    variance = settings.variance - (row @ explained)[:, 0, 0].astype(np.float64)
    return mean, np.clip(variance, 0.0, settings.variance)

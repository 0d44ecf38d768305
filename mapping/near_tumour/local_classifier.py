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
_N_ROUNDS_IN_DOUBT = 40
"""The most rounds where labels may be wrong; a place that has settled takes no more."""
_FIRST_SHARE = 0.4
"""There, share of a round's step that is made at first: whole ones would go back and forth between modes."""
_GROWTH, _CUT = 1.25, 0.5
"""Factors of that share after a step that goes on as the one before did, and after one that turns back."""
_LEAST_SHARE = 0.1
"""That share falls no further, so that a place still gets to its mode."""
_SETTLED = 0.01
"""A place whose latent two rounds in a row moved by less than this has settled."""
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

    def part(self, rows: slice | NDArray[np.intp]) -> Neighbours:
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
        mode = _Mode(places_m[block], neighbours.part(block), settings)
        mean[block], variance[block] = mode.at_centres()
    return mean, variance


def classify_together(
    places_m: NDArray[np.float64],
    centres_m: NDArray[np.float64],
    centre_of: NDArray[np.intp],
    neighbours: Neighbours,
    settings: DetailSettings,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """As `classify`, where the same neighbours answer for all places about a centre: one mode is found for them all.

    Args:
        places_m: The places [m], shape (N, 3).
        centres_m: The centres [m], shape (M, 3).
        centre_of: The number of each place's centre, shape (N,).
        neighbours: The labels that answer for each centre.
        settings: Gives the length, the prior mean and the prior variance.
    """
    mean, variance = np.empty(len(places_m)), np.empty(len(places_m))
    order = np.argsort(centre_of, kind="stable")
    for first in range(0, len(centres_m), _BLOCK):
        block = slice(first, first + _BLOCK)
        ends = np.searchsorted(centre_of[order], (first, first + _BLOCK))
        rows = order[slice(*ends)]
        mode = _Mode(centres_m[block], neighbours.part(block), settings)
        mean[rows], variance[rows] = mode.at(places_m[rows], centre_of[rows] - first)
    return mean, variance


class _Mode:
    """The mode of the latent at the neighbours of some centres."""

    def __init__(
        self, centres_m: NDArray[np.float64], neighbours: Neighbours, settings: DetailSettings
    ) -> None:
        self._centres_m, self._settings = centres_m, settings
        # Seen from their centre, neighbours have coordinates of a few lengths, whose products lose no digits.
        self._offsets = ((neighbours.points_m - centres_m[:, None]) / settings.length_m).astype(np.float32)
        squares = np.einsum("nij,nij->ni", self._offsets, self._offsets)
        between = squares[:, :, None] + squares[:, None]
        between = between - 2.0 * (self._offsets @ self._offsets.transpose(0, 2, 1))
        self._prior = np.float32(settings.variance) * np.exp(-0.5 * np.maximum(between, 0.0))
        self._across = np.float32(settings.variance) * np.exp(-0.5 * squares)
        self._latent = np.where(
            neighbours.is_tumour, np.float32(_FIRST_LATENT[1]), np.float32(_FIRST_LATENT[0])
        )
        kept = np.float32(1.0 - neighbours.false_positive - neighbours.false_negative)
        if np.all(kept == 1.0):
            for _ in range(_N_ROUNDS):
                self._system, self._pull, step = self._round(slice(None), neighbours)
                self._latent = self._latent + step
        else:
            self._settle(neighbours)

    def at_centres(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The latent's mean and variance at the centres, shapes (M,)."""
        row, settings = self._across[:, None], self._settings
        explained = np.linalg.solve(self._system, self._across[:, :, None])
        mean = settings.prior_mean + (row @ self._pull)[:, 0, 0].astype(np.float64)
        variance = settings.variance - (row @ explained)[:, 0, 0].astype(np.float64)
        return mean, np.clip(variance, 0.0, settings.variance)

    def at(
        self, places_m: NDArray[np.float64], centre_of: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The latent's mean and variance at places [m], shape (N, 3), that belong to the centres of these numbers."""
        settings = self._settings
        place = ((places_m - self._centres_m[centre_of]) / settings.length_m).astype(np.float32)
        squares = ((self._offsets[centre_of] - place[:, None]) ** 2).sum(axis=2)
        row = (np.float32(settings.variance) * np.exp(-0.5 * squares))[:, None]
        mean = settings.prior_mean + (row @ self._pull[centre_of])[:, 0, 0].astype(np.float64)
        explained = row @ np.linalg.inv(self._system)[centre_of] @ row.transpose(0, 2, 1)
        variance = settings.variance - explained[:, 0, 0].astype(np.float64)
        return mean, np.clip(variance, 0.0, settings.variance)

    def _settle(self, neighbours: Neighbours) -> None:
        """Goes on where the latent at the centre still moves."""
        n, k = self._latent.shape
        self._system, self._pull = np.empty_like(self._prior), np.empty((n, k, 1), dtype=np.float32)
        centre, is_calm = np.full(n, np.inf), np.zeros(n, dtype=bool)
        share, last = np.full(n, _FIRST_SHARE, dtype=np.float32), np.zeros_like(self._latent)
        moving = np.arange(n)
        for _ in range(_N_ROUNDS_IN_DOUBT):
            self._system[moving], self._pull[moving], step = self._round(moving, neighbours.part(moving))
            along = (step * last[moving]).sum(axis=1)
            factor = np.select([along > 0.0, along < 0.0], [_GROWTH, _CUT], 1.0)
            share[moving] = np.clip(share[moving] * factor, _LEAST_SHARE, 1.0)
            self._latent[moving] += share[moving, None] * step
            last[moving] = step
            now = (self._across[moving][:, None] @ self._pull[moving])[:, 0, 0]
            has_stayed = np.abs(now - centre[moving]) < _SETTLED
            centre[moving] = now
            has_settled = has_stayed & is_calm[moving]
            is_calm[moving] = has_stayed
            moving = moving[~has_settled]
            if not moving.size:
                break

    def _round(
        self, rows: slice | NDArray[np.intp], neighbours: Neighbours
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """A round of Newton's method for some centres.

        Returns:
            The system that was solved, shape (R, k, k), what solves it, shape (R, k, 1), and the step, shape (R, k).
        """
        prior_mean, latent, prior = (
            np.float32(self._settings.prior_mean),
            self._latent[rows],
            self._prior[rows],
        )
        false_positive = np.float32(neighbours.false_positive)
        kept = np.float32(1.0 - neighbours.false_positive - neighbours.false_negative)
        chance = expit(latent)
        slope = kept * np.maximum(chance * (1.0 - chance), np.float32(_LEAST_SLOPE))
        said = false_positive + kept * chance
        spread = np.maximum(said * (1.0 - said), np.float32(_LEAST_SLOPE))
        target = latent + (neighbours.is_tumour - said) / slope - prior_mean
        system, diagonal = prior.copy(), np.arange(prior.shape[1])
        system[:, diagonal, diagonal] += spread / (np.float32(neighbours.weight) * slope**2)
        pull = np.linalg.solve(system, target[:, :, None])
        moved = prior_mean + (prior @ pull)[:, :, 0]
        step = np.clip(moved - latent, -_LARGEST_STEP, _LARGEST_STEP)
        return system, pull, step.astype(np.float32)

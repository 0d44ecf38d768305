"""What a map answers at fixed places from the labels nearby, kept up to date as readings come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..labelled_points import LabelledPoints
from ..settings import DetailSettings, MapSettings
from .label_memory import LabelMemory
from .local_classifier import classify, classify_together

_FAR = 3.0
"""Beyond this many times `doubt_m` the doubt has its full share to a ten-thousandth, and distances need no measure."""


@dataclass(frozen=True, eq=False)
class LocalAnswers:
    """What the labels near places say of them."""

    mean: NDArray[np.float64]
    """The latent's mean, shape (N,); 0 at places that are not near tumour."""
    variance: NDArray[np.float64]
    """The latent's variance, shape (N,); the prior variance at places that are not near tumour."""
    label_distance_m: NDArray[np.float64]
    """Distance to the nearest label [m], shape (N,); infinite where it is beyond what matters."""
    holds_tumour: NDArray[np.bool_]
    """Whether a believed label of tumour has this for its nearest place, and no free label is nearer to it, shape (N,).
    """


class Detail:
    """The answers at N places; `learn` takes in readings, and `answers` works out what they changed."""

    def __init__(
        self, places_m: NDArray[np.float64], map_settings: MapSettings, settings: DetailSettings
    ) -> None:
        """Makes the answers before any reading.

        Args:
            places_m: The places [m], shape (N, 3).
            map_settings: Gives the rates of false labels.
            settings: How places near tumour are answered for.
        """
        self._places_m, self._settings = places_m, settings
        self._rates = (map_settings.false_positive_rate, map_settings.false_negative_rate)
        self._asked_m = _centres_m(places_m, settings.cell_m)
        self._place_tree: KDTree | None = None
        self._forget()

    def _forget(self) -> None:
        """Begins without readings."""
        n, settings = len(self._places_m), self._settings
        self._memory = LabelMemory(
            cube_m=settings.cube_m,
            range_m=2.0 * settings.reach_m,
            false_positive_rate=self._rates[0],
            stray_m=settings.stray_m,
        )
        self._is_near = np.zeros(n, dtype=bool)
        self._is_stale = np.zeros(n, dtype=bool)
        self._last_neighbour_m = np.full(n, np.inf)
        self._mean, self._variance = np.zeros(n), np.full(n, settings.variance)
        self._label_distance_m = np.full(n, np.inf)
        self._is_nearest_tumour = np.zeros(n, dtype=bool)
        self._is_hit = np.zeros(n, dtype=bool)

    def learn(self, reading: LabelledPoints) -> None:
        """Takes in a reading."""
        kept, tumour_m, entered_m = self._memory.add(reading)
        self._note_distances(kept)
        # A label that may err with all about it makes no finding by itself.
        self._note_tumour(tumour_m, tumour_m if reading.weight is None else tumour_m[:0])
        is_answered = self._is_near & ~self._is_stale
        if len(entered_m) and is_answered.any():
            farthest_m = float(self._last_neighbour_m[is_answered].max())
            places, gap_m = _within(self._asked_m, entered_m, farthest_m)
            is_changed = is_answered[places] & (gap_m < self._last_neighbour_m[places])
            self._is_stale[places[is_changed]] = True

    def learn_anew(self, readings: Sequence[LabelledPoints]) -> None:
        """Takes in readings in place of all so far: what `learn` makes of them one after the other, in less time."""
        self._forget()
        self._memory.add_all(readings)
        self._note_distances(LabelledPoints(self._memory.points_m, self._memory.is_tumour))
        found_m = [each.believed_tumour_m(self._rates[0]) for each in readings if each.weight is None]
        self._note_tumour(self._memory.tumour_m, np.concatenate([np.empty((0, 3)), *found_m]))

    def answers(self) -> LocalAnswers:
        """What the labels near the places say of them."""
        self._catch_up()
        return LocalAnswers(
            self._mean,
            self._variance,
            self._label_distance_m,
            self._is_hit & self._is_nearest_tumour,
        )

    def at(self, places_m: NDArray[np.float64]) -> LocalAnswers:
        """What the labels nearby say of any places [m], shape (N, 3); none of them counts as the nearest to a label."""
        other = Detail(places_m, MapSettings(), self._settings)
        other._memory, other._rates = self._memory, self._rates
        everything = LabelledPoints(self._memory.points_m, self._memory.is_tumour)
        other._note_distances(everything)
        if len(self._memory.tumour_m):
            other._is_stale[_within(places_m, self._memory.tumour_m, self._settings.reach_m)[0]] = True
        return other.answers()

    def _note_tumour(self, tumour_m: NDArray[np.float64], finding_m: NDArray[np.float64]) -> None:
        """Notes labels of tumour that can be believed [m], shape (T, 3), and those of them that make findings."""
        if not len(tumour_m):
            return
        reached = _within(self._places_m, tumour_m, self._settings.reach_m)[0]
        self._is_stale[reached[~self._is_near[reached]]] = True
        self._is_near[reached] = True
        if self._place_tree is None:
            self._place_tree = KDTree(self._places_m)
        if len(finding_m):
            self._is_hit[self._place_tree.query(finding_m)[1]] = True

    def _note_distances(self, reading: LabelledPoints) -> None:
        """Notes which labels are nearer to a place than all before."""
        if not len(reading.points_m):
            return
        candidates = _around(self._places_m, reading.points_m, _FAR * self._settings.doubt_m)
        if not candidates.size:
            return
        # The stubs take the neighbours of many places for one.
        answer: Any = KDTree(reading.points_m).query(
            self._places_m[candidates], distance_upper_bound=_FAR * self._settings.doubt_m
        )
        gap_m, nearest = answer
        is_nearer = gap_m < self._label_distance_m[candidates]
        nearer = candidates[is_nearer]
        self._label_distance_m[nearer] = gap_m[is_nearer]
        self._is_nearest_tumour[nearer] = reading.is_occupied[nearest[is_nearer]]

    def _catch_up(self) -> None:
        """Answers anew for the places whose neighbours have changed."""
        stale = np.flatnonzero(self._is_stale)
        if not stale.size:
            return
        settings = self._settings
        if settings.cell_m > 0.0:
            asked_m, asked_of = np.unique(self._asked_m[stale], axis=0, return_inverse=True)
        else:
            asked_m, asked_of = self._places_m[stale], np.arange(len(stale))
        distance_m, nearest = self._memory.neighbours(asked_m, settings.n_neighbours)
        is_full = distance_m.shape[1] == settings.n_neighbours
        self._last_neighbour_m[stale] = distance_m[asked_of, -1] if is_full else np.inf
        # A place all of whose neighbours are free is left to the coarse map, which is as sure of it.
        is_mixed: NDArray[np.bool_] = np.any(self._memory.is_tumour[nearest], axis=1)
        self._mean[stale], self._variance[stale] = 0.0, settings.variance
        mixed = stale[is_mixed[asked_of]]
        neighbours = self._memory.neighbours_of(nearest[is_mixed], self._rates)
        if settings.cell_m > 0.0:
            number = np.cumsum(is_mixed) - 1
            answers = classify_together(
                self._places_m[mixed],
                asked_m[is_mixed],
                number[asked_of[is_mixed[asked_of]]],
                neighbours,
                settings,
            )
        else:
            answers = classify(self._places_m[mixed], neighbours, settings)
        self._mean[mixed], self._variance[mixed] = answers
        self._is_stale[stale] = False


def _centres_m(places_m: NDArray[np.float64], cell_m: float) -> NDArray[np.float64]:
    """The centres [m] of the cubes that places lie in; the places themselves where cubes have no size."""
    return places_m if cell_m == 0.0 else (np.floor(places_m / cell_m) + 0.5) * cell_m


def _around(
    places_m: NDArray[np.float64], points_m: NDArray[np.float64], margin_m: float
) -> NDArray[np.intp]:
    """The places in the box around some points and a margin."""
    low_m, high_m = points_m.min(axis=0) - margin_m, points_m.max(axis=0) + margin_m
    return np.flatnonzero(((places_m >= low_m) & (places_m <= high_m)).all(axis=1))


def _within(
    places_m: NDArray[np.float64], points_m: NDArray[np.float64], margin_m: float
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The places within a margin of some points, and how far they are from the nearest [m]."""
    candidates = _around(places_m, points_m, margin_m)
    if not candidates.size:
        return candidates, np.empty(0)
    gap_m, _ = KDTree(points_m).query(places_m[candidates], distance_upper_bound=margin_m)
    is_within = np.isfinite(gap_m)
    return candidates[is_within], gap_m[is_within]

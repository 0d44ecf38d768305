"""A Hilbert map that answers in more detail where tumour was sensed, and whose probabilities mean what they say.

A kernel is a compromise: one as wide as the coarse map's carries what a reading says to where the next one will be,
and smooths away a tumour that is no wider than itself. So within a centimetre of labels of tumour a local classifier
asks the labels nearest to each place (`local_classifier`). Where these leave the place open, and everywhere else, the
coarse map answers.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree
from scipy.special import logit

from .belief.belief import UpdateReport
from .hilbert_map import HilbertMap
from .labelled_points import LabelledPoints
from .lattice import check_points
from .likelihood import moderation
from .near_tumour.detail import Detail, LocalAnswers
from .prediction import LEAST_PROBABILITY, Prediction
from .settings import DetailSettings, MapSettings
from .storage import (
    DETAILED_MAP,
    checked_array,
    naming_the_file,
    put_under,
    read_arrays,
    split_by_counts,
    taken_from,
    write_arrays,
)
from .threads import one_blas_thread

_JUST_CALLED = 0.05
"""Least score of a place at which tumour was sensed: the map calls it tumour, and says no more."""
_ENOUGH_CALLED = 2
"""This many neighbours that are called stand for what was sensed: with two points a lesion counts as found."""


_TOLD = {"log_odds": np.nan, "weight": 1.0}
"""What readings may tell of each label, with what stands for nothing told."""


class DetailedMap:
    """Belief over where an organ is occupied by tumour, in detail where tumour was sensed; `update` changes it."""

    def __init__(self, coarse: HilbertMap, settings: DetailSettings | None = None) -> None:
        """Takes a map that has had no readings yet.

        Args:
            coarse: A map with a query lattice and without readings.
            settings: How places near tumour are answered for; the defaults if None.
        """
        self.coarse = coarse
        self._settings = settings if settings is not None else DetailSettings()
        self._readings: list[LabelledPoints] = []
        self._detail = Detail(coarse.query_points_m(), coarse.settings, self._settings)

    @property
    def settings(self) -> MapSettings:
        """The settings of the coarse map."""
        return self.coarse.settings

    @property
    def n_weights(self) -> int:
        """Number of hinges of the coarse map."""
        return self.coarse.n_weights

    def update(
        self,
        points_m: ArrayLike,
        is_occupied: ArrayLike,
        *,
        log_odds: ArrayLike | None = None,
        weight: ArrayLike | None = None,
    ) -> UpdateReport:
        """Takes in a reading as `HilbertMap.update` does; the report is the coarse map's."""
        report = self.coarse.update(points_m, is_occupied, log_odds=log_odds, weight=weight)
        # Copies, since the caller may use the arrays again.
        said, counted = (None if each is None else np.array(each, float) for each in (log_odds, weight))
        labels = np.array(is_occupied, dtype=bool)
        self._learn(LabelledPoints(check_points(points_m).copy(), labels, said, counted))
        return report

    def lay_labels(self, readings: Sequence[LabelledPoints], *, is_far: bool = False) -> bool:
        """Has the readings so far lie elsewhere near tumour, and takes in those that come after them.

        The coarse map keeps those that it has where they were, so their moves have to be small beside the spacing of
        its hinges; unless they are far, when it lays them anew too (`HilbertMap.lay`). Into a map without readings all
        are laid as `update` would lay them one after the other.

        Args:
            readings: The same readings, in their order, at other places, and then the new ones.
            is_far: Whether they have moved too far for the coarse map to keep them where they were.

        Returns:
            Whether it did; a coarse map that cannot lay them anew leaves all as it was.
        """
        n_before = len(self._readings)
        if is_far and not self.coarse.lay([each.points_m for each in readings[:n_before]]):
            return False
        for each in readings[n_before:]:
            self.coarse.update(each.points_m, each.is_occupied, log_odds=each.log_odds, weight=each.weight)
        self._readings = list(readings)
        self._detail.learn_anew(self._readings)
        return True

    def revise(self, n_sweeps: int = 1) -> float:
        """Fits every reading again as `HilbertMap.revise` does; the detail never depends on their order."""
        return self.coarse.revise(n_sweeps)

    def settle(self) -> None:
        """Does now what `update` has left for the next, as `HilbertMap.settle`."""
        self.coarse.settle()

    @one_blas_thread()
    def predict(self, points_m: ArrayLike) -> Prediction:
        """The belief at any points [m], shape (N, 3)."""
        points = check_points(points_m)
        prediction = self.coarse.predict(points)
        return self._combined(prediction, self._detail.at(points)) if len(points) else prediction

    @one_blas_thread()
    def predict_lattice(self) -> Prediction:
        """The belief at the points of the query lattice that its mask keeps, in C order.

        A point of the lattice stands for the places that are nearest to it: where a believed label of tumour is among
        these, and no free label is nearer to the point, it is called tumour, unless two of its neighbours on the
        lattice are.
        """
        local = self._detail.answers()
        prediction = self._combined(self.coarse.predict_lattice(), local)
        return self._calling_what_was_sensed(prediction, local.holds_tumour)

    def query_points_m(self) -> NDArray[np.float64]:
        """The points [m] that `predict_lattice` answers for, shape (N, 3)."""
        return self.coarse.query_points_m()

    def carry_samples(self, n_samples: int, *, rng: np.random.Generator) -> None:
        """Draws whole maps from the belief and moves them with every later reading, as `HilbertMap.carry_samples`."""
        self.coarse.carry_samples(n_samples, rng=rng)

    def sample_lattice(self) -> NDArray[np.float64]:
        """The carried draws of the latent at the points that `predict_lattice` answers for, shape (S, N).

        They are the coarse map's draws, moved and scaled at each point to the mean and the variance of the prediction.

        Raises:
            ValueError: If no samples are carried.
        """
        coarse, detailed = self.coarse.predict_lattice(), self.predict_lattice()
        ratio = np.sqrt(detailed.latent_variance / np.maximum(coarse.latent_variance, 1e-30))
        return detailed.latent_mean + ratio * (self.coarse.sample_lattice() - coarse.latent_mean)

    def save(self, path: str | PathLike[str]) -> None:
        """Writes the map to one npz file, whole or not at all; carried samples are not kept."""
        write_arrays(Path(path), DETAILED_MAP, self.state())

    @classmethod
    def load(cls, path: str | PathLike[str]) -> DetailedMap:
        """The map that `save` wrote; given further readings it goes on as if it had never been saved.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If the file is damaged, foreign or of another version; the text names file and reason.
        """
        _, arrays = read_arrays(Path(path), DETAILED_MAP)
        with naming_the_file(Path(path)):
            return cls.from_state(arrays)

    def state(self) -> dict[str, NDArray]:
        """The arrays that make up the map, as a file holds them; carried samples are not among them."""
        told = {
            f"reading_{name}": np.concatenate(
                [np.empty(0), *(_each(reading, name) for reading in self._readings)]
            )
            for name in _TOLD
            if any(getattr(reading, name) is not None for reading in self._readings)
        }
        return {
            "detail_settings": np.array(json.dumps(asdict(self._settings))),
            "reading_counts": np.array([len(r.points_m) for r in self._readings], dtype=np.int64),
            "reading_points_m": np.concatenate([np.empty((0, 3)), *(r.points_m for r in self._readings)]),
            "reading_labels": np.concatenate([np.empty(0, bool), *(r.is_occupied for r in self._readings)]),
            **told,
            **put_under("coarse", self.coarse.state()),
        }

    @classmethod
    def from_state(cls, state: Mapping[str, NDArray]) -> DetailedMap:
        """The map whose arrays `state` gave.

        Raises:
            KeyError: If an array is missing.
            ValueError: If arrays do not fit together or a value is out of its range.
            TypeError: If the settings are not those of a map.
        """
        coarse = HilbertMap.from_state(taken_from("coarse", state))
        restored = cls(coarse, DetailSettings(**json.loads(str(state["detail_settings"]))))
        for reading in _readings_from(state):
            restored._learn(reading)
        return restored

    def _learn(self, reading: LabelledPoints) -> None:
        self._readings.append(reading)
        self._detail.learn(reading)

    def _combined(self, coarse: Prediction, local: LocalAnswers) -> Prediction:
        """What coarse map and local answers say together.

            score = (1 - w) (bias + sharpness kappa(v) m) + w score_far,   w = (v / s^2)^fading

        m and v are the local latent's mean and variance. The score of a prediction is the log-odds of its probability.
        """
        settings = self._settings
        left = local.variance / settings.variance
        weight = left**settings.fading
        near = settings.bias + settings.sharpness * moderation(local.variance) * local.mean
        far = self._from_afar(coarse, local.label_distance_m)
        score = np.where(left < 1.0, (1.0 - weight) * near + weight * far, far)
        variance = left * coarse.latent_variance
        return Prediction(score / moderation(variance), variance)

    def _from_afar(self, coarse: Prediction, distance_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the coarse map's log-odds are worth where labels are far: it is too sure there, either way.

            p_far = (1 - u) p_coarse + u prevalence,   u = doubt (1 - exp(-(d / doubt_m)^2))
            score_far = score_0 + credit (logit(p_far) - score_0) where this is above score_0 = logit(prevalence)

        Args:
            coarse: The coarse map's prediction.
            distance_m: The distance d to the nearest label [m], shape (N,).
        """
        settings, prevalence = self._settings, self.settings.prior_prevalence
        share = settings.doubt * -np.expm1(-((distance_m / settings.doubt_m) ** 2))
        doubted = (1.0 - share) * coarse.probability + share * prevalence
        # Without a doubt the score is kept: its probability may have saturated.
        clipped = np.clip(doubted, LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY)
        score = np.where(share > 0.0, logit(clipped), coarse.score)
        suspicion = np.maximum(score - logit(prevalence), 0.0)
        return score - (1.0 - settings.credit) * suspicion

    def _calling_what_was_sensed(self, prediction: Prediction, holds_tumour: NDArray[np.bool_]) -> Prediction:
        """The prediction with places called tumour that hold a believed label of it and have nobody near to tell.

        Args:
            prediction: The prediction on the query lattice.
            holds_tumour: Where a believed label lies nearest to the place, shape (N,).
        """
        candidates = np.flatnonzero(holds_tumour & (prediction.score < _JUST_CALLED))
        if not candidates.size:
            return prediction
        steps_m = np.array(
            [np.ptp(axis) / max(axis.size - 1, 1) or 1.0 for axis in self.coarse.query.lattice.axes_m]
        )
        places = self.query_points_m() / steps_m
        is_called = prediction.score > 0.0
        score = prediction.score.copy()
        if is_called.any():
            beside = KDTree(places[is_called]).query_ball_point(
                places[candidates], 1.1, p=np.inf, return_length=True
            )
            candidates = candidates[np.asarray(beside) < _ENOUGH_CALLED]
        score[candidates] = _JUST_CALLED
        return Prediction(score / moderation(prediction.latent_variance), prediction.latent_variance)


def _readings_from(state: Mapping[str, NDArray]) -> list[LabelledPoints]:
    labels = np.asarray(state["reading_labels"])
    points_m = checked_array(state, "reading_points_m", (len(labels), 3))
    if labels.dtype != bool:
        raise ValueError(f"its array 'reading_labels' holds {labels.dtype} in place of bool")
    told = {
        name: checked_array(state, f"reading_{name}", (len(labels),), is_finite=False)
        for name in _TOLD
        if f"reading_{name}" in state
    }
    return [
        LabelledPoints(points_m[rows], labels[rows], **{name: array[rows] for name, array in told.items()})
        for rows in split_by_counts(state, "reading_counts", len(labels))
    ]


def _each(reading: LabelledPoints, name: str) -> NDArray[np.float64]:
    """What a reading tells of each label; where it tells nothing, what stands for that."""
    told = getattr(reading, name)
    return np.full(len(reading.points_m), _TOLD[name]) if told is None else told

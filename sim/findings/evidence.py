"""The evidence that findings are made of: the truth, when cones and map got to its points, and the last map.

It comes from a run's folder, or from an episode that writes none, as the trials of a campaign do. Of all actions it
keeps one number a point, however many they were.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit

from mapping import Prediction
from sim.episode.episode import Episode
from sim.episode.measures import FirstSteps, never, note_first
from sim.episode.setup import Setup
from sim.episode.target_belief import TargetBelief
from sim.record.map_field import MapField, called_from
from sim.record.run_record import RunRecord
from sim.world.anatomy.anatomy import Anatomy


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """What is known at the end of an episode of the bodies of one class, and of the map of them."""

    anatomy: Anatomy
    detection_points_m: NDArray[np.float64]
    """Points inside the tumours, world frame, shape (D, 3)."""
    detection_tumours: NDArray[np.int64]
    """The tumour that each of them lies in, shape (D,)."""
    is_attainable: NDArray[np.bool_] | None
    """Which of them reachable poses can sense, shape (D,); None where an older run did not keep it."""
    n_steps: int
    """Actions that were done."""
    first_seen: FirstSteps
    """The action whose cone first held each detection point, shape (D,)."""
    field: MapField | None
    """The last map; None where none was kept."""
    first_called: FirstSteps
    """The action after which the map first called each of its points in the organ tumour, shape (M,)."""
    prior_prevalence: float
    """Share of the organ that the map expected to be tumour before anything was sensed."""
    target: Evidence | None = None
    """The same of a second class; None where none is mapped."""
    visible_fraction: float | None = None
    """Share of the organ that some cone can hold; None where it is not told."""

    @property
    def probability(self) -> float:
        """The probability from which the map calls a point tumour."""
        return called_from(self.prior_prevalence)

    @classmethod
    def of_record(cls, record: RunRecord) -> Evidence:
        """The evidence in a run's folder, finished or not.

        The maps after each action are those that the folder keeps, whose log-odds are rounded to steps of 0.05.
        """
        prior = float(record.config["map"]["prior_prevalence"])
        level = float(logit(called_from(prior)))
        first_called = never(0 if record.field is None else record.field.n_inside)
        for step, log_odds in record.history.items():
            note_first(first_called, step, log_odds > level)
        first_seen = never(len(record.detection_points_m))
        for step, is_held in enumerate(record.is_seen(), start=1):
            note_first(first_seen, step, is_held)
        return cls(
            anatomy=record.anatomy,
            detection_points_m=record.detection_points_m,
            detection_tumours=record.detection_tumours,
            is_attainable=record.is_attainable,
            n_steps=record.n_steps,
            first_seen=first_seen,
            field=record.field,
            first_called=first_called,
            prior_prevalence=prior,
            target=None if record.target is None else cls.of_record(record.target),
            visible_fraction=record.summary.get("visible_fraction"),
        )


class EpisodeWitness:
    """Watches an episode that writes no folder, and has the evidence at its end."""

    def __init__(self, episode: Episode, prior_prevalence: float) -> None:
        """Begin before the first action.

        Args:
            episode: The episode.
            prior_prevalence: Share of the organ that its maps expect to be tumour before anything is sensed.
        """
        self._episode, self._prior, self._n_steps = episode, prior_prevalence, 0
        n_points = len(episode.setup.search_points_m)
        self._first_called, self._first_target = never(n_points), never(n_points)

    def note(self) -> None:
        """Note the action that has just been done."""
        self._n_steps += 1
        level, target = called_from(self._prior), self._episode.target
        if self._episode.prediction is not None:
            note_first(self._first_called, self._n_steps, as_kept(self._episode.prediction) > level)
        if target is not None and target.prediction is not None:
            note_first(self._first_target, self._n_steps, as_kept(target.prediction) > level)

    def evidence(self) -> Evidence:
        """The evidence of all actions so far."""
        episode, target = self._episode, self._episode.target
        own = self._of_class(episode, episode.truth.is_tumour, self._first_called)
        if target is None:
            return own
        return dataclasses.replace(
            own, target=self._of_class(target, target.truth.is_target, self._first_target)
        )

    def _of_class(
        self, known: Episode | TargetBelief, is_true: NDArray[np.bool_], first_called: FirstSteps
    ) -> Evidence:
        truth, prediction = known.truth, known.prediction
        return Evidence(
            anatomy=truth.anatomy,
            detection_points_m=truth.anatomy.detection_points_m,
            detection_tumours=truth.anatomy.detection_tumours,
            is_attainable=truth.is_attainable,
            n_steps=self._n_steps,
            first_seen=known.first_seen,
            field=None if prediction is None else _field(self._episode.setup, prediction, is_true),
            first_called=first_called,
            prior_prevalence=self._prior,
        )


def as_kept(prediction: Prediction) -> NDArray[np.float32]:
    """A map's probabilities as a run's folder keeps them, so that a trial and a run find the same, shape (M,)."""
    return prediction.probability.astype(np.float32)


def _field(setup: Setup, prediction: Prediction, is_true: NDArray[np.bool_]) -> MapField:
    """The last map on its lattice."""
    is_inside = np.ones(len(is_true), dtype=bool)
    return MapField.from_probability(
        setup.query.axes_m,
        setup.on_lattice(as_kept(prediction), outside=np.nan),
        setup.on_lattice(is_inside, outside=False),
        setup.on_lattice(is_true, outside=False),
    )

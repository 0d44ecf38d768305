"""A Hilbert map with finer ones laid into it wherever tumour was sensed.

A kernel is a compromise: one as wide as the coarse map's carries what a reading says to where the next one will be,
and smooths away a tumour that is no wider than itself. So around each cluster of points that were called tumour lies a
box with hinges of its own, closer together and narrower in the same ratio. Its map learns from the same readings and
answers for the points inside the box. Outside the boxes the coarse map answers; with no tumour sensed there are none.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .belief.belief import UpdateReport
from .boxes import Box, boxes_around
from .hilbert_map import HilbertMap
from .inset import Inset
from .labelled_points import LabelledPoints
from .lattice import check_points
from .prediction import Prediction
from .settings import InsetSettings, MapSettings
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


class DetailedMap:
    """Belief over where an organ is occupied by tumour, finer where tumour was sensed; `update` changes it."""

    def __init__(self, coarse: HilbertMap, settings: InsetSettings | None = None) -> None:
        """Takes a map into which nothing is laid yet.

        Args:
            coarse: A map with a query lattice and without readings.
            settings: How the finer maps are made; the defaults if None.
        """
        self.coarse = coarse
        self._settings = settings if settings is not None else InsetSettings()
        self._readings: list[LabelledPoints] = []
        self._tumour_m = np.empty((0, 3))
        self._insets: dict[Box, Inset | None] = {}
        self._n_samples = 0
        self._rng: np.random.Generator | None = None

    @property
    def settings(self) -> MapSettings:
        """The settings of the coarse map."""
        return self.coarse.settings

    @property
    def boxes(self) -> list[Box]:
        """The boxes in which finer maps lie."""
        return [inset.box for inset in self._laid_in()]

    @property
    def n_weights(self) -> int:
        """Number of hinges, those of the finer maps included."""
        return self.coarse.n_weights + sum(inset.fine.n_weights for inset in self._laid_in())

    def update(self, points_m: ArrayLike, is_occupied: ArrayLike) -> UpdateReport:
        """Takes in a reading as `HilbertMap.update` does; the report is the coarse map's."""
        report = self.coarse.update(points_m, is_occupied)
        # Copies, since the caller may use the arrays again.
        reading = LabelledPoints(check_points(points_m).copy(), np.array(is_occupied, dtype=bool))
        self._readings.append(reading)
        tumour_m = reading.believed_tumour_m(self.settings.false_positive_rate)
        self._tumour_m = np.concatenate([self._tumour_m, tumour_m])
        before, self._insets = self._insets, {}
        step_m = self._box_step_m()
        for box in boxes_around(self._tumour_m, margin_m=self._settings.margin_m, step_m=step_m):
            if box not in before:
                self._insets[box] = self._lay_in(box)
                continue
            self._insets[box] = inset = before[box]
            if inset is not None:
                inset.learn(reading)
        return report

    def revise(self, n_sweeps: int = 1) -> float:
        """Fits every reading again as `HilbertMap.revise` does, in the finer maps too.

        Args:
            n_sweeps: How often all readings are gone through.

        Returns:
            The largest change of all maps.
        """
        maps = (self.coarse, *(inset.fine for inset in self._laid_in()))
        return max(each.revise(n_sweeps) for each in maps)

    def predict(self, points_m: ArrayLike) -> Prediction:
        """The belief at any points [m], shape (N, 3)."""
        points = check_points(points_m)
        prediction = self.coarse.predict(points)
        mean, variance = prediction.latent_mean.copy(), prediction.latent_variance.copy()
        for inset in self._laid_in():
            inside = inset.box.holds(points)
            if inside.any():
                fine = inset.fine.predict(points[inside])
                mean[inside], variance[inside] = fine.latent_mean, fine.latent_variance
        return Prediction(mean, variance)

    def predict_lattice(self) -> Prediction:
        """The belief at the points of the query lattice that its mask keeps, in C order."""
        prediction = self.coarse.predict_lattice()
        mean, variance = prediction.latent_mean.copy(), prediction.latent_variance.copy()
        for inset in self._laid_in():
            fine = inset.fine.predict_lattice()
            mean[inset.answers], variance[inset.answers] = fine.latent_mean, fine.latent_variance
        return Prediction(mean, variance)

    def query_points_m(self) -> NDArray[np.float64]:
        """The points [m] that `predict_lattice` answers for, shape (N, 3)."""
        return self.coarse.query_points_m()

    def carry_samples(self, n_samples: int, *, rng: np.random.Generator) -> None:
        """Draws whole maps from the belief and moves them with every later reading.

        Each map has a stream of its own: the coarse map draws from `rng` itself, so its draws are those of a
        `HilbertMap` with this generator; each finer map draws from a child, `rng.spawn(1)`, in the order in which
        they are laid in (those that are there now in the order of `boxes`). A finer map that is laid in later draws
        from its prior, and the readings that it is laid in with move these draws to its posterior.

        Args:
            n_samples: Number of draws, S.
            rng: Source of the draws, now and at every later reading.

        Raises:
            ValueError: If n_samples is below 1, or the form is local and has taken in a reading.
        """
        self.coarse.carry_samples(n_samples, rng=rng)
        self._n_samples, self._rng = n_samples, rng
        for inset in self._laid_in():
            self._carry_samples_of(inset)

    def sample_lattice(self) -> NDArray[np.float64]:
        """The carried draws of the latent at the points that `predict_lattice` answers for, shape (S, N).

        A draw is a whole map, of which the finer maps give the part inside their boxes. No map knows how its latent
        covaries with another's, so the parts of a draw are independent, and at a box's faces a draw has a step.

        Raises:
            ValueError: If no samples are carried.
        """
        draws = self.coarse.sample_lattice()
        for inset in self._laid_in():
            draws[:, inset.answers] = inset.fine.sample_lattice()
        return draws

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
        boxes = list(self._insets)
        state = {
            "inset_settings": np.array(json.dumps(asdict(self._settings))),
            "box_low": np.array([box.low for box in boxes], dtype=np.int64).reshape(-1, 3),
            "box_high": np.array([box.high for box in boxes], dtype=np.int64).reshape(-1, 3),
            "reading_counts": np.array([len(r.points_m) for r in self._readings], dtype=np.int64),
            "reading_points_m": np.concatenate([np.empty((0, 3)), *(r.points_m for r in self._readings)]),
            "reading_labels": np.concatenate([np.empty(0, bool), *(r.is_occupied for r in self._readings)]),
            **put_under("coarse", self.coarse.state()),
        }
        for number, inset in enumerate(self._insets.values()):
            state |= {} if inset is None else put_under(f"inset_{number}", inset.fine.state())
        return state

    @classmethod
    def from_state(cls, state: Mapping[str, NDArray]) -> DetailedMap:
        """The map whose arrays `state` gave.

        Raises:
            KeyError: If an array is missing.
            ValueError: If arrays do not fit together or a value is out of its range.
            TypeError: If the settings are not those of a map.
        """
        coarse = HilbertMap.from_state(taken_from("coarse", state))
        restored = cls(coarse, InsetSettings(**json.loads(str(state["inset_settings"]))))
        restored._readings = _readings_from(state)
        rate = coarse.settings.false_positive_rate
        believed_m = [reading.believed_tumour_m(rate) for reading in restored._readings]
        restored._tumour_m = np.concatenate([restored._tumour_m, *believed_m])
        for number, box in enumerate(_boxes_from(state, restored._box_step_m())):
            arrays = taken_from(f"inset_{number}", state)
            restored._insets[box] = Inset.from_state(box, coarse, arrays) if arrays else None
        return restored

    def _box_step_m(self) -> float:
        return 2.0 * self._settings.hinge_spacing_m

    def _laid_in(self) -> list[Inset]:
        return [inset for inset in self._insets.values() if inset is not None]

    def _lay_in(self, box: Box) -> Inset | None:
        """The inset of a box with all readings so far; None where the coarse map answers."""
        inset = Inset.lay_in(box, self.coarse, self._settings)
        if inset is not None:
            self._carry_samples_of(inset)
            for reading in self._readings:
                inset.learn(reading)
            inset.settle()
        return inset

    def _carry_samples_of(self, inset: Inset) -> None:
        if self._rng is not None:
            inset.fine.carry_samples(self._n_samples, rng=self._rng.spawn(1)[0])


def _readings_from(state: Mapping[str, NDArray]) -> list[LabelledPoints]:
    labels = np.asarray(state["reading_labels"])
    points_m = checked_array(state, "reading_points_m", (len(labels), 3))
    if labels.dtype != bool:
        raise ValueError(f"its array 'reading_labels' holds {labels.dtype} in place of bool")
    return [
        LabelledPoints(points_m[rows], labels[rows])
        for rows in split_by_counts(state, "reading_counts", len(labels))
    ]


def _boxes_from(state: Mapping[str, NDArray], step_m: float) -> list[Box]:
    low, high = (np.asarray(state[f"box_{end}"]) for end in ("low", "high"))
    if low.shape != high.shape or low.shape[1:] != (3,) or {low.dtype.kind, high.dtype.kind} != {"i"}:
        raise ValueError(f"its boxes have corners of shapes {low.shape} and {high.shape}")
    return [
        Box(tuple(low_end), tuple(high_end), step_m)
        for low_end, high_end in zip(low.tolist(), high.tolist(), strict=True)
    ]

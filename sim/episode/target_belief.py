"""The belief about a second class of targets beside the tumours: a map of its own, and how well it knows the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mapping import (
    DetailSettings,
    LabelledPoints,
    MapMetrics,
    MapSettings,
    Prediction,
    TumourMap,
    TumourMapFactory,
    average_precision,
    evaluate_map,
    laid_anew,
)
from planner import Cone
from sim.world.sensing.reading import Reading

from .measures import NEVER, never, note_held
from .planned.checks import checked_map, checked_prediction

if TYPE_CHECKING:
    from mapping.registration import Laid

    from .setup import Setup
    from .truth import TargetTruth


@dataclass(frozen=True)
class TargetScore:
    """How the second class stands after an action."""

    sensed_fraction: float
    """Share of its detection points that lay in some cone so far."""
    auprc: float | None
    """Area under its map's precision-recall curve; None without a map, or where no search point lies in a body."""


class TargetBelief:
    """What an episode learns about the second class. The map of the tumours is neither read nor changed."""

    def __init__(self, truth: TargetTruth, cone: Cone, tumour_map: TumourMap | None) -> None:
        """Begin from the prior.

        Args:
            truth: The bodies of the class.
            cone: What an action senses.
            tumour_map: The class's own map before anything is sensed, which is updated; None keeps no map.
        """
        self.truth = truth
        self.tumour_map = tumour_map
        self.prediction: Prediction | None = None
        self.readings: list[LabelledPoints] = []
        self._cone = cone
        self.first_seen = never(len(truth.anatomy.detection_points_m))
        self._predict()

    @property
    def name(self) -> str:
        """What the class is called."""
        return self.truth.anatomy.name

    def note(self, number: int, reading: Reading, T_world_probe: NDArray[np.float64]) -> None:
        """Note what an action read and which points it held; `learn` teaches the map.

        Args:
            number: The number of the action, from 1.
            reading: What it read.
            T_world_probe: Where the probe's tip truly was, shape (4, 4).

        Raises:
            ValueError: There is a map, and the reading has no labels of the class.
        """
        note_held(self.first_seen, number, self._cone, self.truth.anatomy.detection_points_m, T_world_probe)
        if self.tumour_map is None:
            return
        if reading.is_target is None:
            raise ValueError(
                f"The scene has a second class, {self.name}, but is_target of the reading is None: "
                "the sensor must label its points for that class too."
            )
        self.readings.append(LabelledPoints(reading.points_m, reading.is_target))

    def learn(self, laid: Laid | None, new_map: Callable[[], TumourMap], *, n_new: int = 1) -> None:
        """Teach the map the last readings, or all where the organ is now believed to lie elsewhere.

        Args:
            laid: The tumours' readings where they lie now; None where all lie where they lay.
            new_map: Makes a map without readings.
            n_new: How many readings it was not taught yet.
        """
        if self.tumour_map is None:
            return
        if laid is not None:
            self.readings = [
                own.at(each.points_m) for own, each in zip(self.readings, laid.readings, strict=True)
            ]
        if laid is not None and laid.is_moved:
            self.tumour_map = laid_anew(self.tumour_map, self.readings, new_map, is_far=laid.is_far)
        else:
            for each in self.readings[-n_new:]:
                self.tumour_map.update(each.points_m, each.is_occupied)
        self._predict()

    def score(self) -> TargetScore:
        """The score by what is believed now."""
        auprc = None
        if self.prediction is not None:
            auprc = average_precision(self.prediction.score, self.truth.is_target)
        return TargetScore(float((self.first_seen != NEVER).mean()), auprc)

    def metrics(self) -> MapMetrics | None:
        """The scores of the present map against the truth."""
        return None if self.prediction is None else evaluate_map(self.prediction, self.truth.is_target)

    def _predict(self) -> None:
        if self.tumour_map is not None:
            self.prediction = checked_prediction(self.tumour_map, len(self.truth.is_target))


def target_belief_of(
    truth: TargetTruth | None, cone: Cone, new_map: Callable[[], TumourMap] | None, *, is_needed: bool
) -> TargetBelief | None:
    """The belief about the second class of an episode before anything is sensed; None where there is no such class.

    Args:
        truth: The bodies of the class.
        cone: What an action senses.
        new_map: Makes a map without readings; None where no map is kept.
        is_needed: Whether the planner is shown this belief in place of the tumours'.

    Raises:
        ValueError: It is needed, and there is no such class.
    """
    if truth is not None:
        return TargetBelief(truth, cone, None if new_map is None else new_map())
    if is_needed:
        raise ValueError(
            "plans_for_target=True: the setup has no second class. Give the case a second class, or leave it out."
        )
    return None


def draws_of(
    tumour_map: TumourMap | None,
) -> Callable[[np.random.Generator], NDArray[np.float64]] | None:
    """What draws a whole map from the present belief, of shape (M,); None for a map that cannot.

    Args:
        tumour_map: The map, which may be a user's own; one with `carry_samples` and `sample_lattice` can.
    """
    if not (hasattr(tumour_map, "carry_samples") and hasattr(tumour_map, "sample_lattice")):
        return None
    drawing: Any = tumour_map

    def draw(rng: np.random.Generator) -> NDArray[np.float64]:
        drawing.carry_samples(1, rng=rng)
        return drawing.sample_lattice()[0]

    return draw


def map_maker(
    setup: Setup, make: TumourMapFactory | None, settings: MapSettings, detail: DetailSettings | None
) -> Callable[[], TumourMap] | None:
    """What makes a map before any reading, on the setup's lattices; None where no map is kept."""
    return None if make is None else lambda: checked_map(make(setup.map_space(settings, detail)))

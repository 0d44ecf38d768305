"""The trained planner: a pose is worth the sum of what the open places in its cone are worth, by learned numbers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..baselines.sight import sight_of
from ..errors import PlannerError
from ..find_and_outline.frontier import seen_weight
from ..planner import Planner
from ..situation import Situation
from .features import N_OUTLINE, N_SEARCH, features_of, search_lattice

WEIGHTS = "weights.json"
"""The file of the learned numbers, beside this module."""


@cache
def shipped_weights() -> tuple[float, ...]:
    """The numbers that are shipped: `N_SEARCH` of the search, then `N_OUTLINE` of the outline."""
    told = json.loads(files("planner.trained").joinpath(WEIGHTS).read_text(encoding="utf-8"))
    return (*map(float, told["search"]), *map(float, told["outline"]))


@dataclass(frozen=True, kw_only=True)
class Trained(Planner):
    """Ranks by a sum over the open places in a pose's cone, whose worth a search of parameters learned."""

    needs_belief: ClassVar[bool] = False
    needs_readings: ClassVar[bool] = True

    weights: tuple[float, ...] = field(default_factory=shipped_weights)
    """The learned numbers: those of the search, then those of the outline; by default the shipped ones."""

    def __post_init__(self) -> None:
        """Checks the numbers."""
        if len(self.weights) != N_SEARCH + N_OUTLINE or not np.isfinite(self.weights).all():
            raise PlannerError(f"`weights` must be {N_SEARCH + N_OUTLINE} finite numbers, got {self.weights}")

    def rank(self, situation: Situation) -> Iterator[int]:
        """The poses neither sensed nor skipped, those worth most first; see `Planner.rank`."""
        poses = np.flatnonzero(situation.available(exclude_sensed=True))
        if len(poses):
            score = self.score(situation)[poses]
            # Mostly the first is taken, and the others need no order.
            yield int(poses[np.argmax(score)])
            yield from poses[np.argsort(-score, kind="stable")[1:]].tolist()

    def score(self, situation: Situation) -> NDArray[np.float64]:
        """The worth of each pose [m^3], shape (N,): that of what it would search, and of what it would outline.

            score = sum over open places x in the pose's cone of  v(x) exp(theta . phi(x))

        with v the volume that a place stands for and phi its features.

        Args:
            situation: What is known so far.
        """
        workspace, cone = situation.workspace, situation.cone
        theta = np.array(self.weights)
        lattice = search_lattice(situation.search_points_m)
        sight = sight_of(workspace, cone, lattice.points_m)
        features, places = features_of(situation)
        worth = np.exp(features @ theta[:N_SEARCH])
        worth[sight.held_by(situation.sensed)] = 0.0
        searched = lattice.cell_m3 * sight.sums(worth)
        worth = places.cell_m3 * np.exp(places.features @ theta[N_SEARCH:])
        return searched + seen_weight(workspace, cone, places.points_m, worth)

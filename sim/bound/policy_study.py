"""Where a bound on every policy can be proven, and how it is put together from places and weights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.episode.measures import SENSED_GOAL
from sim.episode.scenario import Scenario
from sim.world.anatomy.anatomy import N_DETECTION_POINTS

from .cover import points_needed
from .places import Place
from .policy import CONFIDENCE, PolicyBound, Worth, apart_weights, share_done
from .search import slots
from .stage import Stage

FIRST_PLACE = 1_000_000
"""Seed of the first place: far from the seeds that people compare planners on."""


def reason_against(stage: Stage, seed: int) -> str | None:
    """Why no bound on every policy can be proven for a scenario; None where one can."""
    scenario = stage.scenario(seed)
    if stage.is_new_each_seed:
        return "every seed has an organ of its own, and the places of tumours are drawn for one organ"
    if scenario.tumour_load != "fixed":
        return "the number of tumours is drawn by seed"
    if scenario.n_tumours and need_of_one(scenario.n_tumours) <= 0:
        return f"with {scenario.n_tumours} tumours one of them need not be sensed at all"
    if stage.setup(seed).given_tumours:
        return "the tumours are given, so a policy may know them"
    return None


def need_of_one(n_tumours: int) -> int:
    """Points of any tumour that have to be sensed at least, where all others are sensed wholly."""
    n_points = N_DETECTION_POINTS * n_tumours
    return points_needed(n_points, SENSED_GOAL) - (n_points - N_DETECTION_POINTS)


def policy_bound(
    places: Sequence[Place],
    weights: Sequence[NDArray[np.float64]],
    worth: Worth,
    scenario: Scenario,
    fewest: Sequence[int | None],
) -> PolicyBound:
    """The bound that weights prove.

    Args:
        places: The places.
        weights: Dual weights for 1, 2, ... actions, shape (n,) each.
        worth: Sums over the places that each pose is early enough for.
        scenario: The scenario.
        fewest: The hindsight optimum of each seed.
    """
    n = len(places)
    middles_m = np.array([place.middle_m for place in places])
    radii_m = np.array([place.radius_m for place in places])
    apart = None
    if scenario.n_tumours > 1 and scenario.tumour_shape == "sphere":
        apart = apart_weights(middles_m, radii_m, scenario.n_tumours)

    def shares(place_weight: NDArray[np.float64]) -> tuple[float, ...]:
        return tuple(
            share_done(worth, slots(k), each, place_weight) for k, each in enumerate(weights, start=1)
        )

    return PolicyBound(
        n_tumours=scenario.n_tumours,
        n_places=n,
        shares=tuple(min(each, 1.0) for each in shares(np.ones(n))),
        weighted=None if apart is None else tuple(map(shares, apart)),
        most_weight=None if apart is None else tuple(float(row.max()) for row in apart),
        fewest=tuple(fewest),
    )


def policy_summary(bound: PolicyBound) -> dict[str, Any]:
    """What bound.json tells of a bound on every policy."""
    is_apart = bound.weighted is not None
    shown = {
        "n_tumours": bound.n_tumours,
        "n_places": bound.n_places,
        "shares": list(bound.shares),
        "weighted": None if bound.weighted is None else [list(row) for row in bound.weighted],
        "most_weight": None if bound.most_weight is None else list(bound.most_weight),
        # One tumour is kept apart from none. Where it is not proven how others are, hindsight alone counts.
        "is_hindsight_alone": bound.n_tumours > 1 and not is_apart,
    }
    for name, each in (("independent", False), ("generator", True)):
        shown[name] = {
            "done": [float(share) for share in bound.done(is_apart=each)],
            "least_mean": bound.least_mean(is_apart=each),
            "least_mean_95": bound.least_mean(is_apart=each, confidence=CONFIDENCE),
        }
    return shown


def bound_of(summary: dict[str, Any], fewest: Sequence[int | None]) -> PolicyBound:
    """The bound that bound.json tells of."""
    weighted, most = summary["weighted"], summary["most_weight"]
    return PolicyBound(
        n_tumours=summary["n_tumours"],
        n_places=summary["n_places"],
        shares=tuple(summary["shares"]),
        weighted=None if weighted is None else tuple(map(tuple, weighted)),
        most_weight=None if most is None else tuple(most),
        fewest=tuple(fewest),
    )

"""Lesions for the benchmark of the stop: of the patients' sizes and even in place, or small and hard to find."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mapping import MapSettings
from planner import LesionPrior
from planner.find_and_outline.hidden_balls import distance_to_cones
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import Setup, build_setup
from sim.world.anatomy.tumour_shapes import ball_shape

EXPECTED, HARD = "as expected", "small, hard places"
HINGES_M = 0.018
"""Spacing of the map's hinges [m]."""
LEAST_GAP_M = 0.002
"""Least distance between planted lesions [m]."""


@lru_cache(maxsize=1)
def setup_of() -> Setup:
    """The setup of all episodes."""
    scenario = replace(SCENARIOS["sphere"], cone_depth_m=0.08, n_tumours=0)
    return build_setup(scenario, None, MapSettings(hinge_spacing_m=HINGES_M))


def n_finders(setup: Setup, centre_m: NDArray[np.float64], radius_m: float) -> int:
    """The number of poses whose cone reaches half the radius into a ball."""
    return int((distance_to_cones(setup.workspace, setup.cone, centre_m[None]) <= radius_m / 2.0).sum())


def place(setup: Setup, radius_m: float, rng: np.random.Generator) -> NDArray[np.float64] | None:
    """A place for a ball, even in the organ; None where the one drawn does not lie in it."""
    low_m, high_m = setup.organ.bounds_m
    centre_m = rng.uniform(low_m, high_m)
    unit_m, _ = ball_shape()
    return centre_m if setup.organ.contains(centre_m + radius_m * unit_m).all() else None


@lru_cache(maxsize=1)
def most_finders_of_hard() -> int:
    """The quartile of the number of poses that find a ball of 9 mm diameter, of those that some pose finds."""
    setup, rng, counts = setup_of(), np.random.default_rng(0), []
    while len(counts) < 400:
        centre_m = place(setup, 0.0045, rng)
        if centre_m is not None and (n := n_finders(setup, centre_m, 0.0045)) > 0:
            counts.append(n)
    return int(np.quantile(counts, 0.25))


def planted(setup: Setup, kind: str, rng: np.random.Generator) -> list[tuple[NDArray[np.float64], float]]:
    """Centres and radii [m] of the lesions of a seed; their number is that of the LiTS patients."""
    prior = LesionPrior()
    n = rng.negative_binomial(
        prior.number_shape, prior.number_shape / (prior.number_shape + prior.mean_number)
    )
    if kind == HARD:
        radii_m = rng.uniform(0.004, 0.005, n)
    else:
        diameter_m = prior.median_diameter_m * np.exp(prior.diameter_spread * rng.normal(size=n))
        radii_m = np.sort(np.clip(diameter_m, *prior.diameter_range_m))[::-1] / 2.0
    balls: list[tuple[NDArray[np.float64], float]] = []
    for radius_m in radii_m.tolist():
        for number in range(1, 4000):
            centre_m = place(setup, radius_m, rng)
            if centre_m is not None and fits(setup, kind, centre_m, radius_m, balls):
                balls.append((centre_m, radius_m))
                break
            if number % 20 == 0 and kind == EXPECTED:
                radius_m *= 5.0 / 6.0
    return balls


def fits(
    setup: Setup,
    kind: str,
    centre_m: NDArray[np.float64],
    radius_m: float,
    others: list[tuple[NDArray[np.float64], float]],
) -> bool:
    """Whether a ball is apart from others and, where that is wanted, hard to find."""
    if any(np.linalg.norm(centre_m - at_m) < radius_m + r_m + LEAST_GAP_M for at_m, r_m in others):
        return False
    return kind != HARD or 1 <= n_finders(setup, centre_m, radius_m) <= most_finders_of_hard()

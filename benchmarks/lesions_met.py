"""How many lesions does a search meet that does nothing else? `.venv/bin/python -m benchmarks.lesions_met`.

Lesions of the law by which a scenario plants them, many draws to an organ. Three orders of poses, none of which
outlines anything or looks twice, are held against them by geometry alone: the search of find-and-outline, and two
greedy covers that know the size of the lesions (balls inside the organ, even in place). The table has the share of
the lesions that some pose can see of which the first k cones hold at least one of forty points, or at least a quarter
of them. What a planner finds within as many actions can hardly be more, since it also has to outline.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from mapping import MapSettings
from planner import FindAndOutline, visibility
from planner.find_and_outline.hidden_balls import BallPrior, hidden_balls
from sim.episode.scenario import GENERATED_LIVER
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import Setup, build_setup
from sim.episode.truth import make_truth
from sim.tables import markdown_table

SEARCHES = {
    "find-and-outline's search": BallPrior(),
    "greedy, balls of 5 to 10 mm": BallPrior(
        radius_range_m=(0.0025, 0.005), overlap_share=0.5, radius_power=0.0
    ),
    "greedy, balls of 10 to 20 mm": BallPrior(
        radius_range_m=(0.005, 0.01), overlap_share=0.5, radius_power=0.0
    ),
}
"""The balls that each search goes by, diameters in the names."""
FADING = FindAndOutline().fading
"""What is left of the weight of a ball that a pose found, as in the planner."""
CLASSES_MM = {"5-10 mm": (5.0, 10.0), "10-20 mm": (10.0, 20.0), "above 20 mm": (20.0, np.inf)}
N_POINTS = 40
QUARTER = 0.25


@dataclass(frozen=True, kw_only=True)
class Options:
    """Which organs, how many draws of lesions in each, and how long the searches are."""

    scenario: str = GENERATED_LIVER
    organs: int = 8
    """Number of generated livers; every other organ is one."""
    first: int = 0
    """Seed of the first."""
    draws: int = 40
    """Number of draws of an organ's lesions."""
    actions: tuple[int, ...] = (15, 30, 60)
    """Numbers of actions."""


def order_of(setup: Setup, prior: BallPrior, n: int) -> list[int]:
    """The first poses of a search that finds nothing."""
    balls = hidden_balls(setup.workspace, setup.cone, setup.search_points_m, setup.surface_distance_m, prior)
    left, order = balls.weights.copy(), list[int]()
    while len(order) < n:
        order.append(int(np.argmax(balls.newly_found(left))))
        left[balls.finds[order[-1]].indices] *= FADING
    return order


def shares_met(
    setup: Setup, orders: list[list[int]], rng: np.random.Generator
) -> list[tuple[float, NDArray[np.float64]]]:
    """Of each lesion of a draw its diameter [mm], and the share met after 1, 2, ... actions of each order."""
    anatomy, met = make_truth(setup, rng).anatomy, []
    for number, solid in enumerate(anatomy.tumours):
        points_m = anatomy.detection_points_m[anatomy.detection_tumours == number]
        points_m = points_m[np.linspace(0, len(points_m) - 1, N_POINTS).astype(int)]
        sees = np.asarray(visibility(setup.workspace, setup.cone, points_m))
        if sees.any():
            diameter_mm = 2e3 * float(np.cbrt(3.0 * solid.volume_m3 / (4.0 * np.pi)))
            shares = [np.logical_or.accumulate(sees[:, order], axis=1).mean(axis=0) for order in orders]
            met.append((diameter_mm, np.array(shares)))
    return met


def main(options: Options) -> None:
    """Print the table."""
    lesions: list[tuple[float, NDArray[np.float64]]] = []
    scenario = load_scenario(options.scenario)
    is_generated = scenario.has_organ(GENERATED_LIVER)
    n_organs = options.organs if is_generated else 1
    for seed in tqdm(range(options.first, options.first + n_organs), unit="organ"):
        of_seed = replace(scenario, organ_seed=seed) if is_generated else scenario
        setup = build_setup(of_seed, None, MapSettings())
        orders = [order_of(setup, prior, max(options.actions)) for prior in SEARCHES.values()]
        for draw in range(options.draws):
            lesions += shares_met(setup, orders, np.random.default_rng([seed, draw]))
    at = [number - 1 for number in options.actions]
    rows = []
    for name, (low_mm, high_mm) in CLASSES_MM.items():
        some_shares = [share for diameter_mm, share in lesions if low_mm <= diameter_mm < high_mm]
        if not some_shares:
            continue
        shares = np.array(some_shares)
        for number, search in enumerate(SEARCHES):
            some = shares[:, number, at]
            texts = [f"{(share > 0.0).mean():.2f} / {(share >= QUARTER).mean():.2f}" for share in some.T]
            rows.append([name, str(len(shares)), search, *texts])
    head = [
        "lesions",
        "number",
        "search",
        *(f"{number} actions: met / a quarter" for number in options.actions),
    ]
    print(markdown_table(head, rows))


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))

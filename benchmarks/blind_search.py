"""How many sensings a search needs to touch a ball in the paper's organ: `.venv/bin/python -m benchmarks.blind_search`.

Only geometry counts, without map and readings: before anything is found, what a search does next does not depend on the
truth, so one sequence of poses is held against any number of planted balls. No planner is told their radius, except in
the last row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import tyro
from numpy.typing import NDArray

from mapping import MapSettings
from planner import FindAndOutline, Situation, Workspace, make_planner, visibility
from planner.find_and_outline.hidden_balls import BallPrior, distance_to_cones, hidden_balls
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import Setup, build_setup
from sim.world.anatomy.tumours import LEAST_ATTAINABLE, SPHERE_DEPTH_RANGE_M, SPHERE_HALF_WIDTH_M

PAIR_GAP_M = 0.02
"""One first pose of a pair is tried in each cube of this side."""
TOUCH_M = 0.002
"""A cone that reaches this deep into a ball returns points of it."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to plant and how far to search."""

    radii_mm: tuple[float, ...] = (6.0, 12.0, 20.0)
    """Radii of the planted balls [mm]."""
    n_balls: int = 300
    """Number of balls that are planted of each radius."""
    n_sensings: int = 120
    """Length of a search, with which balls that are never touched count."""


def planted(setup: Setup, radius_m: float, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Centres of balls where the scenario plants its spheres, 95 % visible, shape (n, 3)."""
    middle_m, centres = setup.organ.bounds_m.mean(axis=0)[:2], []
    while len(centres) < n:
        place_m = middle_m + rng.uniform(-SPHERE_HALF_WIDTH_M, SPHERE_HALF_WIDTH_M, 2)
        top_m = setup.organ.top_height_m(place_m[None])[0]
        centre_m = np.array([*place_m, top_m - rng.uniform(*SPHERE_DEPTH_RANGE_M)])
        directions = rng.normal(size=(60, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        points_m = centre_m + radius_m * np.cbrt(rng.random((60, 1))) * directions
        if not setup.organ.contains(centre_m + radius_m * directions).all():
            continue
        if visibility(setup.workspace, setup.cone, points_m).any(axis=1).mean() >= LEAST_ATTAINABLE:
            centres.append(centre_m)
    return np.array(centres)


def sequence(
    setup: Setup, planner_name: str, n: int, *, knows_surface: bool = True, **options: object
) -> list[int]:
    """The poses that a planner senses as long as it finds nothing."""
    planner, sensed, rng = make_planner(planner_name, **options), [], np.random.default_rng(0)
    for _ in range(n):
        situation = Situation(
            workspace=setup.workspace,
            cone=setup.cone,
            search_points_m=setup.search_points_m,
            surface_distance_m=setup.surface_distance_m if knows_surface else None,
            prediction=None,
            sensed=tuple(sensed),
            rng=rng,
        )
        if isinstance(planner, FindAndOutline):
            # Without a map there is nothing to outline, so only the search counts.
            score = planner.search_score(situation)
            score[sensed] = -1.0
            sensed.append(int(np.argmax(score)))
        else:
            sensed.append(next(iter(planner.rank(situation))))
    return sensed


def pair_sequence(setup: Setup, n: int, planner: FindAndOutline | None = None) -> list[int]:
    """The poses of a search that looks a step ahead: the better half of the best pair, with some fifty first halves."""
    planner, sensed = planner or FindAndOutline(), []
    balls = hidden_balls(
        setup.workspace, setup.cone, setup.search_points_m, setup.surface_distance_m, planner.balls
    )
    left = balls.weights.copy()
    for _ in range(n):
        gain = balls.newly_found(left)
        firsts = setup.workspace.best_apart(gain.astype(np.float64), PAIR_GAP_M)
        rows = balls.finds[firsts].toarray()
        pairs = [
            gain[first] + balls.newly_found(left * (1.0 - row)).max()
            for first, row in zip(firsts, rows, strict=True)
        ]
        sensed.append(int(firsts[int(np.argmax(pairs))]))
        left = left * np.where(balls.finds[sensed[-1]].toarray().ravel() > 0, planner.fading, 1.0).astype(
            np.float32
        )
    return sensed


def touches(
    workspace: Workspace, setup: Setup, centres_m: NDArray[np.float64], radius_m: float
) -> NDArray[np.bool_]:
    """Which poses touch which balls, shape (B, N)."""
    return distance_to_cones(workspace, setup.cone, centres_m) <= radius_m - TOUCH_M


def first_touch(
    setup: Setup, sensed: list[int], centres_m: NDArray[np.float64], radius_m: float
) -> NDArray[np.intp]:
    """The number of the sensing that first touches each ball, shape (B,); the last where none does."""
    some = Workspace(setup.workspace.positions_m[sensed], setup.workspace.normals[sensed])
    hits = touches(some, setup, centres_m, radius_m)
    return np.where(hits.any(axis=1), hits.argmax(axis=1) + 1, len(sensed))


def main(options: Options) -> None:
    """Print a row per search and a column per radius: mean and 95th percentile of the first touch."""
    setup, n = build_setup(SCENARIOS["sphere"], None, MapSettings()), options.n_sensings
    radii_m = [radius_mm * 1e-3 for radius_mm in options.radii_mm]
    rng = np.random.default_rng(1000)
    balls = [planted(setup, radius_m, options.n_balls, rng) for radius_m in radii_m]
    name = "find-and-outline"
    sequences = {
        "random": sequence(setup, "random", n),
        "multi-resolution": sequence(setup, "multi-resolution", n),
        name: sequence(setup, name, n),
        "looking one step ahead": pair_sequence(setup, n),
        "balls may protrude from the organ": sequence(setup, name, n, knows_surface=False),
        "balls of 2 mm (nearly points)": sequence(
            setup, name, n, balls=BallPrior(radius_range_m=(0.0019, 0.0021))
        ),
        "balls of 3 to 10 mm": sequence(setup, name, n, balls=BallPrior(radius_range_m=(0.003, 0.010))),
        "balls of 12 to 25 mm": sequence(setup, name, n, balls=BallPrior(radius_range_m=(0.012, 0.025))),
        "found half way to the centre": sequence(setup, name, n, balls=BallPrior(overlap_share=0.5)),
        "found at first touch": sequence(setup, name, n, balls=BallPrior(overlap_share=0.0)),
        "found at the centre": sequence(setup, name, n, balls=BallPrior(overlap_share=1.0)),
    }
    print(
        "first touch, mean / 95th percentile, for radii of", ", ".join(f"{r:g} mm" for r in options.radii_mm)
    )
    for label, sensed in sequences.items():
        print_row(label, [first_touch(setup, sensed, b, r) for b, r in zip(balls, radii_m, strict=True)])
    counts = []
    for centres_m, radius_m in zip(balls, radii_m, strict=True):
        prior = BallPrior(radius_range_m=(0.99 * radius_m, 1.01 * radius_m))
        counts.append(first_touch(setup, sequence(setup, name, n, balls=prior), centres_m, radius_m))
    print_row("told the radius", counts)


def print_row(label: str, counts: list[NDArray[np.intp]]) -> None:
    """Print one line of the table."""
    cells = [f"{count.mean():6.1f} /{np.quantile(count, 0.95):4.0f}" for count in counts]
    print(f"{label:36s}" + "   ".join(cells), flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options))

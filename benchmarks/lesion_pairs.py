"""How many lesions are counted where one or two are planted: `.venv/bin/python -m benchmarks.lesion_pairs`.

On scenario `sphere` with a free probe, each episode runs until all was outlined. Pairs of which a lesion was never met
by a label are left out, since the count is about what was met.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import tyro
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from mapping import DetailSettings, MapSettings
from planner import FindAndOutline
from sim.episode.attainment import attainable
from sim.episode.episode import Episode
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import Setup, build_setup
from sim.tables import markdown_table
from sim.world.anatomy.tumour_shapes import ball_shape
from sim.world.solids.solid import Solid


@dataclass(frozen=True, kw_only=True)
class Options:
    """What to plant."""

    diameters_mm: tuple[float, ...] = (9.0, 14.0, 24.0)
    """Diameters of the lesions [mm]."""
    gaps_mm: tuple[float, ...] = (3.0, 5.0, 8.0, 12.0, 17.0)
    """Distances between the surfaces of two [mm]; a column of single lesions comes before."""
    first: int = 2000
    """First seed."""
    seeds: int = 6
    """Number of seeds of each."""
    steps: int = 60
    """Largest number of sensing actions."""


def planted(
    setup: Setup, diameter_m: float, gap_m: float | None, rng: np.random.Generator
) -> tuple[Solid, ...]:
    """One ball or two in the organ, in a drawn direction, each of which cones can hold to 95 %."""
    (unit_m, faces), middle_m = ball_shape(), setup.organ.bounds_m.mean(axis=0)[:2]
    while True:
        place_m = middle_m + rng.uniform(-0.05, 0.05, 2)
        depth_m = rng.uniform(0.025, 0.08)
        centre_m = np.array([*place_m, setup.organ.top_height_m(place_m[None])[0] - depth_m])
        way = rng.normal(size=3)
        half_m = 0.0 if gap_m is None else (diameter_m + gap_m) / 2.0
        offset_m: NDArray[np.float64] = half_m * way / np.linalg.norm(way)
        centres_m = [centre_m] if gap_m is None else [centre_m - offset_m, centre_m + offset_m]
        bodies = tuple(Solid(at_m + unit_m * diameter_m / 2.0, faces) for at_m in centres_m)
        if all(is_good_place(setup, body.vertices_m) for body in bodies):
            return bodies


def is_good_place(setup: Setup, points_m: NDArray[np.float64]) -> bool:
    """Whether points lie in the organ and cones can hold 95 % of them."""
    if not setup.organ.contains(points_m).all():
        return False
    return float(attainable(setup.workspace, setup.cone, points_m, setup.positioner).mean()) > 0.95


def counted(setup: Setup, bodies: tuple[Solid, ...], seed: int, n_steps: int) -> int | None:
    """The number of lesions that are counted once all that was found is outlined; None where one was never met."""
    planner = FindAndOutline()
    given = replace(setup, given_tumours=bodies, tumour_names=())
    episode = Episode(given, planner, seed=seed, detail=DetailSettings())
    is_met = np.zeros(len(bodies), dtype=bool)
    for step in episode.steps(n_steps):
        labels_m = step.reading.points_m[step.reading.is_occupied]
        is_met |= np.array([body.contains(labels_m).any() for body in bodies], dtype=bool)
        # The confidence is 0 as long as something is left to outline.
        if is_met.all() and episode.confidence() > 0.0:
            break
    return planner.what_is_left(episode.situation()).n_found if is_met.all() else None


def main(options: Options) -> None:
    """Print the mean count, and how often it is right, by diameter and gap."""
    setup = build_setup(SCENARIOS["sphere"], None, MapSettings())
    rows = []
    with threadpool_limits(limits=1):
        for diameter_mm in options.diameters_mm:
            cells = [f"{diameter_mm:g} mm"]
            for gap_mm in (None, *options.gaps_mm):
                counts: list[int] = []
                for seed in range(options.first, options.first + options.seeds):
                    rng = np.random.default_rng((seed, round(10 * diameter_mm), round(10 * (gap_mm or 0.0))))
                    bodies = planted(
                        setup, diameter_mm * 1e-3, None if gap_mm is None else gap_mm * 1e-3, rng
                    )
                    n = counted(setup, bodies, seed, options.steps)
                    counts += [] if n is None else [n]
                n_right = sum(n == (1 if gap_mm is None else 2) for n in counts)
                cells.append(f"{np.mean(counts):.2f} ({n_right} of {len(counts)})" if counts else "-")
            rows.append(cells)
            print(" | ".join(cells), flush=True)
    print(
        markdown_table(
            ("diameter", "one", *(f"two, {gap_mm:g} mm apart" for gap_mm in options.gaps_mm)), rows
        )
    )


if __name__ == "__main__":
    main(tyro.cli(Options))

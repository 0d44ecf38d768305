"""What does it cost to lay all readings of a map elsewhere, at once or one after the other, and do the maps agree?

    .venv/bin/python -m benchmarks.moved_readings [--scenario liver] [--counts 5 10 20 30] [--move-mm 4] [--seed 1000]

The readings of one episode (find-and-outline, no arm) are moved by a shift, and turned about the organ's middle by as
much as takes a place that is 100 mm away as far. Times are CPU milliseconds, the least of some rounds of both in turn;
their ratio holds on a busy machine, the times do not. The differences are those of probabilities between the two maps
and, beside it, between the map that was moved and the one that was not.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import process_time

import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from benchmarks.detailed_map import played
from mapping import HilbertMap, MapSettings
from sim.episode.setup import Setup
from sim.tables import markdown_table

_ARM_M = 0.1
Readings = list[tuple[NDArray[np.float64], NDArray[np.bool_]]]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print a row for each number of readings."""

    scenario: str = "liver"
    counts: tuple[int, ...] = (5, 10, 20, 30)
    """Numbers of readings."""
    move_mm: float = 4.0
    """Length of the shift."""
    seed: int = 1000
    rounds: int = 3


def taught(setup: Setup, readings: Readings) -> HilbertMap:
    """The coarse map of some readings."""
    learner = HilbertMap(
        setup.hinges,
        MapSettings(),
        query=setup.query,
        query_mask=setup.is_inside,
        hinge_mask=setup.hinge_mask,
    )
    for points_m, is_occupied in readings:
        learner.update(points_m, is_occupied)
    return learner


def row(setup: Setup, readings: Readings, options: Options) -> list[str]:
    """Times and differences for some readings."""
    shift_m = 1e-3 * options.move_mm * np.array([0.6, 0.0, 0.8])
    R = Rotation.from_rotvec(shift_m[[2, 0, 1]] / _ARM_M).as_matrix()
    middle_m = setup.organ.bounds_m.mean(axis=0)
    moved = [((points_m - middle_m) @ R.T + middle_m + shift_m, labels) for points_m, labels in readings]
    times_s, still = [], taught(setup, readings)
    at_once, anew = still, still
    for _ in range(options.rounds):
        at_once = taught(setup, readings)
        start_s = process_time()
        at_once.lay([points_m for points_m, _ in moved])
        middle_s = process_time()
        anew = taught(setup, moved)
        times_s.append((process_time() - middle_s, middle_s - start_s))
    anew_ms, at_once_ms = 1e3 * np.min(times_s, axis=0)
    mine, yours, old = (each.predict_lattice().probability for each in (at_once, anew, still))
    return [
        str(len(readings)),
        f"{anew_ms:.0f}",
        f"{at_once_ms:.0f}",
        f"{anew_ms / at_once_ms:.1f}",
        f"{np.abs(mine - yours).mean():.5f} / {np.abs(old - yours).mean():.5f}",
        f"{np.abs(mine - yours).max():.2f} / {np.abs(old - yours).max():.2f}",
    ]


def main(options: Options) -> None:
    """Print the table."""
    episode = played(options.seed, options.scenario, "find-and-outline", max(options.counts))
    readings = [(each.points_m, each.is_occupied) for each in episode.readings]
    head = (
        "readings", "one after the other [ms]", "at once [ms]", "times sooner",
        "mean difference / of the move", "largest difference / of the move",
    )  # fmt: skip
    with threadpool_limits(1):
        rows = [row(episode.setup, readings[:count], options) for count in options.counts]
    print(markdown_table(head, rows))


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))

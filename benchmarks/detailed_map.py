"""What does the detail near sensed tumour change? The detailed map against the plain one within it, on equal readings.

    .venv/bin/python -m benchmarks.detailed_map [--scenario spheres liver generated-liver] [--seeds 20] [--first 0]
        [--readings 30] [--planner find-and-outline] [--jobs 2]

An episode without an arm gives the readings; both maps have learnt them. A point is in doubt where 0.02 < p < 0.98, and
calibration error and slope are over those points (`benchmarks.calibration`). Places never sensed are those farther than
15 mm from every sensed point: of them the table tells what share the map says is tumour, and what share is. A lesion
counts as found where the map calls at least two points of the lattice in it or next to it tumour, and as called where
it calls one; false pieces touch no lesion.
"""

from __future__ import annotations

import dataclasses
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.spatial import KDTree
from scipy.special import expit
from threadpoolctl import threadpool_limits

from benchmarks.calibration import calibration_slope
from mapping import (
    DetailedMap,
    DetailSettings,
    MapSettings,
    average_precision,
    dice,
    expected_calibration_error,
    log_loss,
)
from planner import make_planner
from sim.episode.episode import Episode
from sim.episode.scenario import GENERATED_LIVER
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import build_setup

CLASSES_MM = (0.0, 5.0, 10.0, 20.0, np.inf)
NEVER_SENSED_M = 0.015
Maps = dict[str, NDArray[np.float64]]


def played(seed: int, scenario: str, planner: str, n_readings: int) -> Episode:
    """An episode after its last action."""
    with threadpool_limits(1):
        wanted = load_scenario(scenario)
        if wanted.has_organ(GENERATED_LIVER):
            wanted = dataclasses.replace(wanted, organ_seed=seed)
        setup = build_setup(wanted, None, MapSettings())
        episode = Episode(setup, make_planner(planner), seed=seed, detail=DetailSettings())
        for _ in episode.steps(n_readings):
            pass
    return episode


def run(seed: int, *, scenario: str, planner: str, n_readings: int) -> dict[str, Any]:
    """The scores of both maps after an episode, the truth, and each lesion's points."""
    episode = played(seed, scenario, planner, n_readings)
    setup, tumour_map = episode.setup, episode.tumour_map
    assert isinstance(tumour_map, DetailedMap)
    scores = {
        "plain": tumour_map.coarse.predict_lattice().score,
        "detailed": tumour_map.predict_lattice().score,
    }
    sensed_m = np.concatenate([reading.points_m for reading in episode.readings])
    gap_m, _ = KDTree(sensed_m).query(setup.search_points_m, distance_upper_bound=NEVER_SENSED_M)
    anatomy = episode.truth.anatomy
    # The stubs take the neighbours of many points for one.
    nearest: Any = KDTree(setup.search_points_m).query(anatomy.detection_points_m)[1]
    lesions = [np.unique(nearest[anatomy.detection_tumours == i]) for i in range(len(anatomy.tumours))]
    diameters_mm = [2e3 * np.cbrt(3 * solid.volume_m3 / (4 * np.pi)) for solid in anatomy.tumours]
    pieces = {
        name: _pieces(setup.on_lattice(score > 0, outside=False))[setup.is_inside]
        for name, score in scores.items()
    }
    return {
        "scores": scores,
        "truth": episode.truth.is_tumour,
        "is_never_sensed": np.isinf(gap_m),
        "lesions": [
            (
                diameter,
                {name: int((score[cells] > 0).sum()) for name, score in scores.items()},
                bool(setup.is_visible[cells].any()),
            )
            for diameter, cells in zip(diameters_mm, lesions, strict=True)
        ],
        "n_false": {
            name: len(set(of.tolist()) - {0} - {int(p) for cells in lesions for p in of[cells]})
            for name, of in pieces.items()
        },
    }


def _pieces(is_called: NDArray[np.bool_]) -> NDArray[np.intp]:
    numbered: Any = label(is_called, structure=np.ones((3, 3, 3)))
    return np.asarray(numbered[0]).ravel()


def row(name: str, runs: list[dict[str, Any]]) -> list[str]:
    """The figures of one map over all runs."""
    scores, truths = [each["scores"][name] for each in runs], [each["truth"] for each in runs]
    pairs = [pair for pair in zip(scores, truths, strict=True) if pair[1].any()]
    score, truth = np.concatenate(scores), np.concatenate(truths)
    probability, never = expit(score), np.concatenate([each["is_never_sensed"] for each in runs])
    doubt = (probability > 0.02) & (probability < 0.98)
    base = truth.mean()
    skill = 1 - log_loss(score, truth) / log_loss(np.full(truth.size, np.log(base / (1 - base))), truth)
    return [
        f"{np.mean([average_precision(*pair) or 0.0 for pair in pairs]):.3f}",
        f"{np.mean([dice(s > 0, t) or 0.0 for s, t in pairs]):.3f}",
        f"{doubt.sum():,}",
        f"{expected_calibration_error(probability[doubt], truth[doubt]):.3f}",
        f"{calibration_slope(score[doubt], truth[doubt]):.2f}",
        f"{skill:.3f}",
        f"{1e4 * probability[never].mean():.0f} / {1e4 * truth[never].mean():.0f}" if never.any() else "–",
        *(_found(name, runs, low, high) for low, high in pairwise(CLASSES_MM)),
        f"{np.mean([each['n_false'][name] for each in runs]):.2f}",
    ]


def _found(name: str, runs: list[dict[str, Any]], low_mm: float, high_mm: float) -> str:
    counts = [
        n[name] for each in runs for d, n, visible in each["lesions"] if visible and low_mm <= d < high_mm
    ]
    if not counts:
        return "–"
    return f"{sum(n >= 2 for n in counts)} ({sum(n >= 1 for n in counts)}) of {len(counts)}"


def main() -> None:
    """Print the table."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", nargs="+", default=["spheres", "liver", "generated-liver"])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--readings", type=int, default=30)
    parser.add_argument("--planner", default="find-and-outline")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    head = [
        "scenario",
        "map",
        "AUPRC",
        "Dice",
        "in doubt",
        "calibration error",
        "slope",
        "skill",
        "never sensed: says / is [1e-4]",
    ]
    classes = ["below 5 mm", "5-10 mm", "10-20 mm", "above 20 mm"]
    print(f"| {' | '.join([*head, *(f'found (called), {each}' for each in classes), 'false a run'])} |")
    print("|" + "---|" * (len(head) + len(classes) + 1))
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        for scenario in arguments.scenario:
            work = partial(run, scenario=scenario, planner=arguments.planner, n_readings=arguments.readings)
            runs = list(pool.map(work, seeds))
            for name in ("plain", "detailed"):
                print(f"| {' | '.join([scenario, name, *row(name, runs)])} |", flush=True)


if __name__ == "__main__":
    main()

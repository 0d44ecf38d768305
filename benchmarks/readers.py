"""What is left of map and search where the reader errs, and do probabilities still mean what they say?

    .venv/bin/python -m benchmarks.readers [--scenario spheres] [--readings 50] [--readers exact flips published]
        [--trust learnt] [--seeds 20] [--first 0] [--jobs 2]

Episodes of find-and-outline with a free probe. `flips` gets 5 per cent of all labels wrong, one by one; `published`
errs as published readers of liver ultrasound do. Actions to 95 % are those until 95 % of the tumours was sensed,
`--readings` where it never was, and `never` counts these. Points in doubt have 0.02 < p < 0.98. A finding is a piece
that the map calls tumour; of those whose likeliest point has at least 0.9, the table tells how many touch a lesion.
Rates are the means of those that the trust has learnt in the end.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from multiprocessing import get_context
from typing import Any, Literal, get_args

import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.spatial import KDTree
from scipy.special import expit
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from benchmarks.calibration import calibration_slope
from mapping import (
    DetailSettings,
    MapSettings,
    TrustSettings,
    average_precision,
    dice,
    expected_calibration_error,
)
from planner import make_planner
from sim.comparison.estimates import mean_estimate
from sim.comparison.texts import interval_text
from sim.episode.episode import Episode
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import Setup, build_setup
from sim.running.reader import told_rates
from sim.tables import markdown_table
from sim.world.sensing.errors.erring_sensor import ErringSensor
from sim.world.sensing.errors.published import PUBLISHED
from sim.world.sensing.errors.reader_errors import ReaderErrors

Reader = Literal["exact", "flips", "published"]
Trust = Literal["learnt", "told", "exact"]
ERRORS = {
    "exact": ReaderErrors(),
    "flips": ReaderErrors(flipped_free=0.05, flipped_tumour=0.05),
    "published": PUBLISHED,
}
SENSED, SURE = 0.95, 0.9


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print a row for each reader and trust."""

    scenario: str = "spheres"
    readings: int = 50
    readers: tuple[Reader, ...] = get_args(Reader)
    trust: tuple[Trust, ...] = ("learnt",)
    """How labels of readers that err are trusted; the exact reader's always are."""
    seeds: int = 20
    first: int = 0
    """First seed."""
    jobs: int = 2


@lru_cache(maxsize=1)
def setup_of(scenario: str) -> Setup:
    """Organ and workspace, which all seeds share."""
    return build_setup(load_scenario(scenario), None, MapSettings())


def play(seed: int, *, reader: Reader, trust: Trust, options: Options) -> dict[str, Any]:
    """What became of one episode."""
    with threadpool_limits(1):
        setup = setup_of(options.scenario)
        settings = None
        if reader != "exact" and trust != "exact":
            told = told_rates(ERRORS[reader], setup.cone)
            settings = TrustSettings() if trust == "learnt" else TrustSettings(rates=told, learns=False)
        episode = Episode(
            setup,
            make_planner("find-and-outline"),
            seed=seed,
            sensor=ErringSensor(errors=ERRORS[reader]),
            trust=settings,
            detail=DetailSettings() if settings is None else DetailSettings.of_many_labels(),
        )
        needed, steps = None, list(episode.steps(options.readings))
        needed = next((step.step for step in steps if (step.sensed_fraction or 0.0) >= SENSED), None)
    assert episode.prediction is not None
    truth, score = episode.truth.is_tumour, episode.prediction.score
    rates = episode.trust.rates
    return {
        "needed": needed,
        "auprc": average_precision(score, truth),
        "dice": dice(score > 0, truth),
        "score": score,
        "truth": truth,
        "rates": (rates.false_positive, rates.false_negative, rates.missed, rates.invented),
        "update_s": np.mean([step.update_s + step.plan_s for step in steps]),
        **lesions_of(episode, score),
    }


def lesions_of(episode: Episode, score: NDArray[np.float64]) -> dict[str, Any]:
    """The lesions, with their diameters and whether they were found, and the findings, with how sure and how true."""
    setup, anatomy = episode.setup, episode.truth.anatomy
    numbered: Any = label(setup.on_lattice(score > 0.0, outside=False), structure=np.ones((3, 3, 3)))
    pieces = np.asarray(numbered[0]).ravel()[setup.is_inside]
    # The stubs take the neighbours of many points for one.
    nearest: Any = KDTree(setup.search_points_m).query(anatomy.detection_points_m)[1]
    lesions, touched = [], set()
    for number, solid in enumerate(anatomy.tumours):
        cells = np.unique(nearest[anatomy.detection_tumours == number])
        diameter_mm = 2e3 * np.cbrt(3.0 * solid.volume_m3 / (4.0 * np.pi))
        lesions.append(
            (diameter_mm, int((score[cells] > 0.0).sum()) >= 2, bool(setup.is_visible[cells].any()))
        )
        touched |= set(pieces[cells].tolist())
    findings = [
        (float(expit(score[pieces == piece].max())), piece in touched)
        for piece in range(1, int(pieces.max(initial=0)) + 1)
    ]
    return {"lesions": lesions, "findings": findings}


def row(name: str, runs: list[dict[str, Any]], readings: int) -> list[str]:
    """The figures of some episodes."""
    score, truth = (np.concatenate([each[key] for each in runs]) for key in ("score", "truth"))
    doubt = np.abs(score) < np.log(0.98 / 0.02)
    needed = [each["needed"] for each in runs]
    actions = mean_estimate(np.array([readings if each is None else each for each in needed], float))
    auprc = mean_estimate(np.array([each["auprc"] for each in runs]))
    sure = [is_real for each in runs for p, is_real in each["findings"] if p >= SURE]
    false = np.mean([sum(not is_real for _, is_real in each["findings"]) for each in runs])
    error = expected_calibration_error(expit(score[doubt]), truth[doubt])
    rates = np.mean([each["rates"] for each in runs], axis=0)
    return [
        name,
        f"{actions.mean:.1f} {interval_text(actions.interval, '{:.1f}')}",
        str(needed.count(None)),
        f"{auprc.mean:.3f} {interval_text(auprc.interval, '{:.3f}')}",
        f"{np.mean([each['dice'] for each in runs]):.3f}",
        _found(runs, 0.0, 10.0),
        _found(runs, 10.0, np.inf),
        f"{false:.2f}",
        f"{sum(sure)} of {len(sure)}",
        f"{error:.3f} / {calibration_slope(score[doubt], truth[doubt]):.2f} ({int(doubt.sum()):,})",
        " ".join(f"{each:.3g}" for each in rates),
        f"{1e3 * np.mean([each['update_s'] for each in runs]):.0f}",
    ]


def _found(runs: list[dict[str, Any]], low_mm: float, high_mm: float) -> str:
    found = [
        is_found
        for each in runs
        for diameter_mm, is_found, is_visible in each["lesions"]
        if is_visible and low_mm <= diameter_mm < high_mm
    ]
    return f"{sum(found)} of {len(found)}" if found else "-"


def main(options: Options) -> None:
    """Print the table."""
    head = [
        f"{options.scenario}, {options.readings} readings",
        "actions to 95 %",
        "never",
        "AUPRC",
        "Dice",
        "found, below 10 mm",
        "10 mm and more",
        "false a run",
        "real, of findings of 0.9",
        "calibration error / slope (points in doubt)",
        "learnt: p+ p- missed invented",
        "map and plan [ms]",
    ]
    rows, seeds = [], range(options.first, options.first + options.seeds)
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        for reader in options.readers:
            for trust in options.trust if reader != "exact" else ("exact",):
                work = partial(play, reader=reader, trust=trust, options=options)
                runs = list(tqdm(pool.map(work, seeds), total=len(seeds), desc=f"{reader}, {trust}"))
                rows.append(row(f"{reader}, {trust}", runs, options.readings))
                print(" | ".join(rows[-1]), flush=True)
    print("\n" + markdown_table(head, rows))


if __name__ == "__main__":
    # Worker processes find functions by the name of their module, which is not `__main__` there.
    from benchmarks import readers

    readers.main(tyro.cli(readers.Options))

"""How well the reader of images reads: single sweeps of organs on which it was not trained.

    .venv/bin/python -m benchmarks.image_reader [--livers 10] [--views 24] [--first 0]
    .venv/bin/python -m benchmarks.image_reader --organs lits_27_predtum unc_p2_HCC_031 skvtk_patient

Every view is a sweep from a random pose, of the generated livers of seeds from --first on with their clinical loads of
lesions, or with --organs of patients' livers in $SOUNDING_DATA/livers with their own lesions, vessels and gallbladder.
The lesions are once all hypoechoic, once hyperechoic, once isoechoic, and once each of a look of its own.
benchmarks/image_reader_views.py says what is counted. Intervals are from resampling organs, and beside the sensitivity
stands the number of views of lesions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np
import tyro
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from benchmarks.image_reader_views import LesionView, View, views_of
from benchmarks.patients import cases
from mapping import MapSettings
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import Setup, build_setup
from sim.running.fields import config_of
from sim.running.parts import scenario_of
from sim.tables import markdown_table
from sim.world.sensing.image_reader.image_reader import ImageReader
from sim.world.sensing.image_reader.weights import load_weights

TISSUES = ("hypoechoic", "hyperechoic", "isoechoic", "by-lesion")
SIZES_MM = ((0.0, 10.0), (10.0, 20.0), (20.0, np.inf))
LEAST_VIEWS = 10
"""A mean of fewer views of lesions has no interval."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print the reader's figures by tissue and diameter."""

    livers: int = 10
    views: int = 24
    """Views of each organ and tissue."""
    first: int = 0
    """First seed."""
    organs: tuple[str, ...] = ()
    """Patients' livers in place of generated ones."""
    tissues: tuple[str, ...] = TISSUES
    weights: Path | None = None
    """Weights in place of the shipped ones."""


def setups(options: Options) -> Iterator[tuple[str, int, Setup]]:
    """The name, the seed and the setup of each organ."""
    if not options.organs:
        for seed in range(options.first, options.first + options.livers):
            scenario = replace(load_scenario("generated-liver"), organ_seed=seed)
            yield str(seed), seed, build_setup(scenario, None, MapSettings())
    for name in options.organs:
        found = [files for label, files in cases(name) if label.split()[0] == name]
        if not found:
            print(f"{name} is left out: no such folder in $SOUNDING_DATA/livers")
        for files in found:
            yield (
                name,
                options.first,
                build_setup(scenario_of(config_of(**files, arm="none")), None, MapSettings()),
            )


def main(options: Options) -> None:
    """Print the tables."""
    reader = ImageReader(weights=load_weights(options.weights))
    print(f"weights: {reader.weights.trained}")
    views: dict[tuple[str, str], list[View]] = {}
    with threadpool_limits(1):
        for name, seed, setup in tqdm(setups(options)):
            for tissue in options.tissues:
                views[name, tissue] = list(views_of(setup, seed, tissue, options.views, reader))
        _print_speed(reader)
    names = list(dict.fromkeys(name for name, _ in views))
    rows = [
        row for tissue in options.tissues for row in _rows(tissue, [views[name, tissue] for name in names])
    ]
    head = ["lesions", "diameter", "views", "found", "Dice, of all", "Dice, of found", "boundary [mm]"]
    print(markdown_table(head, rows))
    head = ["lesions", "specificity", "false blobs a view", "calibration error"]
    print(
        markdown_table(
            head, [_whole(tissue, [views[name, tissue] for name in names]) for tissue in options.tissues]
        )
    )
    if options.organs:
        head = ["organ", "lesions", "views", "found", "Dice, of all", "Dice, of found", "boundary [mm]"]
        of_all = [(name, _rows(tissue, [own])[-1]) for (name, tissue), own in views.items()]
        print(markdown_table(head, [[name, row[0], *row[2:]] for name, row in of_all]))


def _rows(tissue: str, organs: list[list[View]]) -> list[list[str]]:
    """A row for each diameter and one for all, and where looks differ one for each look."""
    lesions = [[lesion for view in views for lesion in view.lesions] for views in organs]
    kinds = [
        (f"{low:g} mm and more" if np.isinf(high) else f"{low:g}-{high:g} mm", low, high)
        for low, high in SIZES_MM
    ]
    rows = []
    looks = sorted({each.looks for own in lesions for each in own} - {tissue})
    for look in looks:
        rows.append(
            _row(f"{tissue}: {look}", "all", [[e for e in own if e.looks == look] for own in lesions])
        )
    for text, low, high in kinds:
        own = [[each for each in one if low <= 1e3 * each.diameter_m < high] for one in lesions]
        rows.append(_row(tissue, text, own))
    return [*rows, _row(tissue, "all", lesions)]


def _row(tissue: str, size: str, organs: list[list[LesionView]]) -> list[str]:
    found = [[each for each in own if each.is_found] for own in organs]
    return [
        tissue,
        size,
        str(sum(map(len, organs))),
        _mean([[float(each.is_found) for each in own] for own in organs]),
        _mean([[each.dice for each in own] for own in organs]),
        _mean([[each.dice for each in own] for own in found]),
        _mean([[1e3 * each.boundary_m for each in own if each.boundary_m is not None] for own in found], 2),
    ]


def _whole(tissue: str, organs: list[list[View]]) -> list[str]:
    """Specificity, false blobs and calibration over all views."""
    views = [view for own in organs for view in own]
    specificity = 1.0 - sum(view.called_m3 for view in views) / sum(view.free_m3 for view in views)
    n, n_lesion, chance = np.sum([view.counts for view in views], axis=0).T
    is_doubt = np.arange(20) * (n > 0) > 0
    error = float(np.abs(n_lesion - chance)[is_doubt].sum() / max(n[is_doubt].sum(), 1.0))
    blobs = _mean([[float(view.n_false) for view in own] for own in organs])
    return [tissue, f"{specificity:.4f}", blobs, f"{error:.3f}"]


def _mean(organs: list[list[float]], digits: int = 3) -> str:
    """The mean over all views with its interval, from resampling organs."""
    kept = [each for each in organs if each]
    if not kept:
        return "-"
    sums, counts = np.array([sum(each) for each in kept]), np.array([len(each) for each in kept])
    mean = f"{sums.sum() / counts.sum():.{digits}f}"
    if len(kept) < 4 or counts.sum() < LEAST_VIEWS:
        return mean
    chosen = np.random.default_rng(0).integers(len(kept), size=(2000, len(kept)))
    low, high = np.quantile(sums[chosen].sum(axis=1) / counts[chosen].sum(axis=1), (0.025, 0.975))
    return f"{mean} [{low:.{digits}f}, {high:.{digits}f}]"


def _print_speed(reader: ImageReader) -> None:
    """Print the time of an action of 16 planes and that of the reader in it."""
    from benchmarks.ultrasound_speed import state_over_liver, timed, told
    from sim.world.sensing.image_reader.reading_sensor import ReadingSensor

    state, rng, sensor = state_over_liver(), np.random.default_rng(0), ReadingSensor(reader=reader)
    start_s = perf_counter()
    sweep = sensor.sense(state, rng).images
    print(f"first action: {perf_counter() - start_s:.2f} s")
    array = sensor.ultrasound.array_of(state.cone)
    assert sweep is not None
    reads_s = [timed(lambda: reader.read(sweep, array)) for _ in range(9)]
    print(f"the reader of 16 planes: {told(reads_s, 's', 3)}")
    actions_s = [timed(lambda: sensor.sense(state, rng)) for _ in range(9)]
    print(f"an action of 16 planes with its reader: {told(actions_s, 's', 3)}")


if __name__ == "__main__":
    main(tyro.cli(Options))

"""Speed and error of the map at the paper's size, against a plain dense form in the same run.

    .venv/bin/python -m benchmarks.map_speed [--readings 50] [--threads 1]

Every row takes in the same cones of 1,000 points on 2,890 hinges with 3 EM iterations and answers with
mean, variance and probability on all 6,292 points. Errors are the largest differences in probability from
the exact path.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.spheres import make_map, random_readings
from mapping import HilbertMap, MapSettings

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))
from dense_reference import CholeskyReference, DenseDiagonal, DenseReference


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--readings", type=int, default=50)
    parser.add_argument("--dense-readings", type=int, default=4)
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    with threadpool_limits(arguments.threads):
        run(arguments.readings, arguments.dense_readings)


def run(n_readings: int, n_dense: int) -> None:
    readings = list(random_readings(0, n_readings))
    settings = {
        "exact": MapSettings(tolerance=0.0, n_em_iterations=3),
        "default": MapSettings(n_em_iterations=3),
        "local": MapSettings(form="local", n_em_iterations=3),
        "diagonal": MapSettings(form="diagonal", n_em_iterations=3),
    }
    rows, answers = {}, {}
    for name, chosen in settings.items():
        rows[name], answers[name] = timed_map(make_map(chosen), readings)
    query_m = make_map(settings["default"]).query_points_m()
    for name, kind in (("dense", CholeskyReference), ("dense diagonal", DenseDiagonal)):
        rows[name], answers[name] = timed_reference(kind, settings["default"], readings[:n_dense], query_m)
    report(rows, answers, n_readings, n_dense)
    report_draws(settings["default"], readings[:30])


def timed_map(belief: HilbertMap, readings):
    times, answers = [], []
    for points_m, is_occupied in readings:
        start, start_cpu = perf_counter(), process_time()
        belief.update(points_m, is_occupied)
        answers.append(belief.predict_lattice().probability)
        times.append((perf_counter() - start, process_time() - start_cpu))
    return np.array(times), answers


def timed_reference(kind: type[DenseReference], settings: MapSettings, readings, query_m):
    reference = kind(
        make_map(settings).hinges.points_m(),
        gamma_per_m2=settings.gamma_per_m2,
        weight_variance=settings.weight_variance,
        prevalence=settings.prior_prevalence,
        n_iterations=settings.n_em_iterations,
    )
    times, answers = [], []
    for points_m, is_occupied in readings:
        start, start_cpu = perf_counter(), process_time()
        reference.update(points_m, is_occupied)
        answers.append(reference.predict(query_m)[2])
        times.append((perf_counter() - start, process_time() - start_cpu))
    return np.array(times), answers


def report(rows, answers, n_readings: int, n_dense: int) -> None:
    late = {name: times[min(20, len(times) // 2) :] for name, times in rows.items()}
    wall_ms = {name: 1e3 * np.median(times[:, 0]) for name, times in late.items()}
    print(
        "| form | median ms | least ms | CPU ms | times faster than dense | error after 1 | after the last |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, times in late.items():
        base = "dense diagonal" if "diagonal" in name else "dense"
        first, last = (abs(answers[name][k] - answers["exact"][k]).max() for k in (0, len(answers[name]) - 1))
        error = "" if "diagonal" in name else f"{first:.1e} | {last:.1e}"
        median, least, cpu = (
            1e3 * np.median(times[:, 0]),
            1e3 * times[:, 0].min(),
            1e3 * np.median(times[:, 1]),
        )
        ratio = wall_ms[base] / wall_ms[name]
        print(f"| {name} | {median:.0f} | {least:.0f} | {cpu:.0f} | {ratio:.0f} | {error or ' | '} |")
    print(f"\n{n_readings} readings, timed after 20; the dense forms take {n_dense}. BLAS has `--threads`.")


def report_draws(settings: MapSettings, readings, n_samples: int = 100) -> None:
    """Print what it costs to carry draws of whole maps along and to spread them over the lattice."""
    plain, drawing = make_map(settings), make_map(settings)
    drawing.carry_samples(n_samples, rng=np.random.default_rng(0))
    costs = []
    for points_m, is_occupied in readings:
        start = perf_counter()
        plain.update(points_m, is_occupied)
        middle = perf_counter()
        drawing.update(points_m, is_occupied)
        drawing.sample_lattice()
        costs.append(perf_counter() - middle - (middle - start))
    print(f"{n_samples} draws of whole maps cost {1e3 * np.median(costs[10:]):.0f} ms a reading.")


if __name__ == "__main__":
    main()

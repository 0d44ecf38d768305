"""Speed and error of the map at the paper's size, against a plain dense form in the same run.

    .venv/bin/python -m benchmarks.map_speed [--readings 50] [--threads 1]
    .venv/bin/python -m benchmarks.map_speed --against DIR [--scenario liver] [--seed 1000] [--rounds 3] [--form full]

Every row takes in the same cones of 1,000 points on 2,890 hinges with 3 EM iterations and answers with
mean, variance and probability on all 6,292 points. Errors are the largest differences in probability from
the exact path.

With `--against`, the readings of one episode (find-and-outline, no arm) go to this code and to that of another checkout
in turn, each in a process of its own. The ratio of two rounds' CPU times holds on a busy machine, the times do not.
"""

from __future__ import annotations

import os
import subprocess
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.spheres import make_map, random_readings
from mapping import HilbertMap, LabelledPoints, MapSettings
from mapping.belief.reduction import reduce_by_pivots
from mapping.kernel import HingeFeatures, feature_products
from sim.episode.setup import Setup

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))
from dense_reference import CholeskyReference, DenseDiagonal, DenseReference

LEAST_SAID = 3e-3
"""Share of a direction's variance that a reading takes away at least, or it is left out (mapping/belief/full.py)."""
# Run by either checkout, so it knows nothing but what the map has offered for long.
REPLAY = """
import sys
from pathlib import Path
from time import process_time
import numpy as np
from mapping import HilbertMap, Lattice, MapSettings
folder, form = Path(sys.argv[1]), sys.argv[2]
given = dict(np.load(folder / "readings.npz"))
hinges, query = (Lattice(tuple(given[f"{name}_{n}"] for n in range(3))) for name in ("hinges", "query"))
belief = HilbertMap(hinges, MapSettings(form=form), query=query, query_mask=given["query_mask"],
                    hinge_mask=given["hinge_mask"])
cpu_s, sizes = [], []
for n in range(sum(name.startswith("points_") for name in given)):
    start_s = process_time()
    report = belief.update(given[f"points_{n}"], given[f"labels_{n}"])
    cpu_s.append(process_time() - start_s)
    sizes.append((report.rank, report.n_weights_touched))
np.savez(folder / "answer.npz", cpu_s=cpu_s, sizes=sizes, probability=belief.predict_lattice().probability)
"""


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--readings", type=int, default=50)
    parser.add_argument("--dense-readings", type=int, default=4)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--scenario", default="liver")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--form", default="full")
    arguments = parser.parse_args()
    if arguments.against is not None:
        compare(arguments)
        return
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


def compare(arguments: Namespace) -> None:
    """Print a row a round: CPU ms of an update here and there, and how far apart the last probabilities are."""
    # Only this comparison needs the simulator.
    from benchmarks.detailed_map import played

    here = Path(__file__).resolve().parents[1]
    episode = played(arguments.seed, arguments.scenario, "find-and-outline", arguments.readings)
    setup = episode.setup
    arrays = {f"hinges_{n}": axis for n, axis in enumerate(setup.hinges.axes_m)}
    arrays |= {f"query_{n}": axis for n, axis in enumerate(setup.query.axes_m)}
    arrays |= {"hinge_mask": setup.hinge_mask, "query_mask": setup.is_inside}
    for n, reading in enumerate(episode.readings):
        arrays |= {f"points_{n}": reading.points_m, f"labels_{n}": reading.is_occupied}
    print("| round | CPU ms there | CPU ms here | times faster | largest difference in probability |")
    print("|---|---|---|---|---|")
    with TemporaryDirectory() as folder:
        np.savez(Path(folder) / "readings.npz", allow_pickle=False, **arrays)
        sizes = np.ones(2)
        for number in range(1, arguments.rounds + 1):
            (there_ms, there, _), (here_ms, now, sizes) = (
                replayed(root, Path(folder), arguments.form) for root in (arguments.against, here)
            )
            ratio, error = there_ms / here_ms, abs(there - now).max()
            print(f"| {number} | {there_ms:.0f} | {here_ms:.0f} | {ratio:.2f} | {error:.1e} |")
    report_floor(setup, episode.readings, int(sizes[0]), int(sizes[1]))


def report_floor(setup: Setup, readings: Sequence[LabelledPoints], rank: int, n_touched: int) -> None:
    """Print the products of which a reading consists, and what they take at the rate of this machine's products.

    Args:
        setup: The episode's.
        readings: Its readings.
        rank: Directions in which a reading moves the belief, the median.
        n_touched: Weights whose variance it changes, the median.
    """
    features = HingeFeatures.build(setup.hinges, MapSettings().gamma_per_m2, setup.hinge_mask)
    sizes = np.median([sizes_of(features, each.points_m) for each in readings[10:]], axis=0)
    n, r, h, n_telling = map(int, sizes[:4])
    n_rounds, n_weights = MapSettings().n_em_iterations, features.n_weights
    print(
        f"A reading of {n} points has {r} pivots, whose features reach {h} of {n_weights} weights; {n_telling} "
        f"directions could say more than {LEAST_SAID:g}, and {rank} move the belief."
    )
    gflop = {
        "C Sigma, of pivots in groups of 64": 2e-9 * r * sizes[4] * n_weights,
        "C Sigma C^T and R, B": 2e-9 * (r * h * r + n * r * r),
        f"the fit, {n_rounds} rounds": 1e-9 * n_rounds * (2 * n * r**2 + r**3),
        "Y Z": 2e-9 * rank * (r * r + r * n_weights),
        "G G^T, its lower half": 1e-9 * n_touched**2 * rank,
    }
    rate = product_rate()
    print("| product | GFLOP | ms at the rate of products |\n|---|---|---|")
    for name, size in {**gflop, "together": sum(gflop.values())}.items():
        print(f"| {name} | {size:.2f} | {1e3 * size / rate:.0f} |")
    print(f"Products ran at {rate:.0f} GFLOP/s in single precision.")


def sizes_of(features: HingeFeatures, points_m: NDArray[np.float64]) -> tuple[float, ...]:
    """Points, pivots, weights in reach, directions that could tell more than `LEAST_SAID`, and weights of a group.

    Directions are those before all readings, and a group is of 64 pivots that lie together.
    """
    settings = MapSettings()
    cutoff = 10.0 * settings.tolerance
    box = features.box_around(points_m, cutoff)
    factors, weights = features.along_axes(points_m, box), features.weights_in(box)
    C = reduce_by_pivots(factors, weights >= 0, tolerance=settings.tolerance, cutoff=cutoff).directions
    # A label's precision is 2 lambda, at most 1/4.
    said = 0.25 * settings.weight_variance * np.linalg.eigvalsh(feature_products(factors, factors))
    groups = np.array_split(np.argsort(C.argmax(axis=1), kind="stable"), max(1, len(C) // 64))
    reach = np.mean([np.count_nonzero(C[group].any(axis=0)) for group in groups])
    return len(points_m), *C.shape, int((said > LEAST_SAID).sum()), float(reach)


def product_rate(n: int = 1024) -> float:
    """The rate of a product of two large matrices [GFLOP/s], the best of seven."""
    square, times_s = np.ones((n, n), dtype=np.float32), []
    with threadpool_limits(1):
        for _ in range(7):
            start_s = process_time()
            np.matmul(square, square)
            times_s.append(process_time() - start_s)
    return 2e-9 * n**3 / min(times_s)


def replayed(root: Path, folder: Path, form: str) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """The median CPU time [ms] of an update by the code of a checkout, the last probabilities, rank and weights."""
    environment = {**os.environ, "PYTHONPATH": str(root.resolve()), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-P", "-c", REPLAY, str(folder), form]
    subprocess.run(command, env=environment, cwd=folder, check=True)
    with np.load(folder / "answer.npz") as answer:
        sizes = np.median(answer["sizes"][10:], axis=0)
        return 1e3 * float(np.median(answer["cpu_s"][10:])), answer["probability"], sizes


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

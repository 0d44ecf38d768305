"""Time, memory and quality as the number of hinges grows, with as many query points as hinges.

    .venv/bin/python -m benchmarks.map_scaling [--hinges 361 2890 23120 185000] [--readings 6]
        [--figure docs/figures/scaling.png]

There are two ways to grow: `organ`, a larger box at the paper's spacing, and `resolution`, a finer lattice in the
paper's box. Both have gamma spacing^2 = 0.70 and 3 EM iterations. Each size runs in a process of its own, so that its
peak memory is its own.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.spheres import BOX_M, Pose, Spheres, candidate_poses, cone_points
from mapping import HilbertMap, Lattice, MapSettings, evaluate_map

COUNTS = {361: (9, 8, 5), 2890: (17, 17, 10), 23120: (34, 34, 20), 185000: (68, 68, 40)}


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--hinges", type=int, nargs="+", choices=COUNTS, default=list(COUNTS))
    parser.add_argument(
        "--growth", nargs="+", choices=["organ", "resolution"], default=["organ", "resolution"]
    )
    parser.add_argument("--readings", type=int, default=6)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--figure", type=Path, default=None)
    parser.add_argument("--one", action="store_true", help="print one size as JSON (used by the loop itself)")
    arguments = parser.parse_args()
    if arguments.one:
        with threadpool_limits(arguments.threads):
            print(json.dumps(measure(arguments.growth[0], arguments.hinges[0], arguments.readings)))
        return
    print("| growth | hinges | form | s per reading | least s | rank | touched | peak MB | AUPRC |")
    print("|---|---|---|---|---|---|---|---|---|")
    rows = []
    for growth in arguments.growth:
        for n_hinges in arguments.hinges:
            row = in_own_process(growth, n_hinges, arguments.readings, arguments.threads)
            rows.append(row)
            print(
                "| {growth} | {n_hinges} | {form} | {median_s:.2f} | {least_s:.2f} | {rank:.0f} "
                "| {touched:.0f} | {peak_mb:.0f} | {auprc:.2f} |".format(**row),
                flush=True,
            )
    if arguments.figure is not None:
        draw(rows, arguments.figure)


def in_own_process(growth: str, n_hinges: int, n_readings: int, n_threads: int) -> dict:
    command = [sys.executable, "-m", "benchmarks.map_scaling", "--one", "--growth", growth]
    command += ["--hinges", str(n_hinges), "--readings", str(n_readings), "--threads", str(n_threads)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def grown_box_m(growth: str, counts: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The corners of the box that the hinges fill: it grows with them, or they lie closer."""
    if growth == "resolution":
        low_m, high_m = np.array(BOX_M, dtype=float)
        return low_m, high_m
    extent_m = (np.array(counts) - 1) * 0.01125
    return np.array([-extent_m[0] / 2, -extent_m[1] / 2, -extent_m[2]]), extent_m * (0.5, 0.5, 0.0)


def map_settings(lattice: Lattice) -> MapSettings:
    """The settings with the paper's kernel, as wide in spacings, and the form of belief that suits the size."""
    spacing_m = float(lattice.axes_m[0][1] - lattice.axes_m[0][0])
    return MapSettings(
        hinge_spacing_m=spacing_m,
        gamma_per_m2=0.703125 / spacing_m**2,
        form="full" if lattice.n_points < 5000 else "local",
        n_em_iterations=3,
    )


def measure(growth: str, n_hinges: int, n_readings: int) -> dict:
    counts = COUNTS[n_hinges]
    scale = (np.array(counts) - 1) / 16 if growth == "organ" else np.ones(3)
    low_m, high_m = grown_box_m(growth, counts)
    lattice = Lattice.from_counts(low_m, high_m, counts=counts)
    settings = map_settings(lattice)
    belief = HilbertMap(lattice, settings, query=lattice)
    truth_rng, pose_rng, sensor_rng = np.random.default_rng(0).spawn(3)
    truth = Spheres.planted(truth_rng)
    times, ranks, touched = [], [], []
    for number, pose in enumerate(candidate_poses(pose_rng, n_readings)):
        apex_m = pose.apex_m * (*scale[:2], 1.0)
        # Every second cone looks at a tumour, so that the map has something to find.
        if number % 2:
            apex_m = np.array([*truth.centres_m[number // 2 % 3, :2], 0.0])
        points_m = cone_points(Pose(apex_m, pose.axis), sensor_rng, box_m=(low_m, high_m))
        start = perf_counter()
        report = belief.update(points_m, truth.contain(points_m))
        belief.predict_lattice().probability.sum()
        times.append(perf_counter() - start)
        ranks.append(report.rank)
        touched.append(report.n_weights_touched)
    half = len(times) // 2
    return {
        "growth": growth,
        "n_hinges": lattice.n_points,
        "form": settings.form,
        "median_s": float(np.median(times[half:])),
        "least_s": float(np.min(times[half:])),
        "rank": float(np.median(ranks[half:])),
        "touched": float(np.median(touched[half:])),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "auprc": evaluate_map(belief.predict_lattice(), truth.contain(lattice.points_m())).auprc or 0.0,
    }


def draw(rows: list[dict], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(8, 3.5), layout="constrained")
    for growth in ("organ", "resolution"):
        chosen = [row for row in rows if row["growth"] == growth]
        n_hinges = [row["n_hinges"] for row in chosen]
        axes[0].loglog(n_hinges, [row["median_s"] for row in chosen], "o-", label=growth)
        axes[1].loglog(n_hinges, [row["peak_mb"] for row in chosen], "o-", label=growth)
    axes[0].set(xlabel="hinges", ylabel="update + query [s]", ylim=(1e-3, None))
    axes[1].set(xlabel="hinges", ylabel="peak memory [MB]")
    axes[0].legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()

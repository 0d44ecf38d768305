"""How fine should the hinges lie? AUPRC and Dice over hinge spacing and gamma, on one set of readings.

.venv/bin/python -m benchmarks.resolution [--seeds 5] [--readings 50] [--figure docs/figures/resolution.png]
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.spheres import map_by_random, truth_of
from mapping import MapSettings, evaluate_map

SPACINGS_M = (0.0225, 0.016, 0.01125, 0.009)
GAMMA_SPACING2 = (0.35, 0.52, 0.7, 1.4)


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--readings", type=int, default=50)
    parser.add_argument("--figure", type=Path, default=None)
    arguments = parser.parse_args()
    print(
        "| spacing mm | gamma spacing^2 | hinges | AUPRC | Dice | ms per reading |\n|---|---|---|---|---|---|"
    )
    results = {}
    with threadpool_limits(1):
        for product in GAMMA_SPACING2:
            for spacing_m in SPACINGS_M:
                results[product, spacing_m] = study(spacing_m, product, arguments.seeds, arguments.readings)
    if arguments.figure is not None:
        draw(results, arguments.figure)


def study(spacing_m: float, product: float, n_seeds: int, n_readings: int) -> tuple[float, float]:
    settings = MapSettings(hinge_spacing_m=spacing_m, gamma_per_m2=product / spacing_m**2)
    start, scores = perf_counter(), []
    for seed in range(n_seeds):
        belief = map_by_random(seed, n_readings, settings)
        scores.append(evaluate_map(belief.predict_lattice(), truth_of(seed, belief.query_points_m())))
    step_ms = 1e3 * (perf_counter() - start) / (n_seeds * n_readings)
    auprc, overlap = np.mean([s.auprc for s in scores]), np.mean([s.dice for s in scores])
    numbers = f"{auprc:.3f} | {overlap:.3f} | {step_ms:.0f}"
    print(f"| {1e3 * spacing_m:g} | {product:g} | {belief.n_weights} | {numbers} |", flush=True)
    return float(auprc), float(overlap)


def draw(results: dict[tuple[float, float], tuple[float, float]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(8, 3.5), layout="constrained", sharex=True)
    for which, (name, axis) in enumerate(zip(("AUPRC", "Dice"), axes, strict=True)):
        for product in GAMMA_SPACING2:
            values = [results[product, spacing_m][which] for spacing_m in SPACINGS_M]
            axis.plot([1e3 * s for s in SPACINGS_M], values, "o-", label=f"gamma spacing$^2$ = {product:g}")
        axis.set(xlabel="hinge spacing [mm]", ylabel=name, ylim=(0, 1))
    axes[0].legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()

"""Does it help to know how often the sensor errs? Labels are flipped at random, for maps with and without the rates.

.venv/bin/python -m benchmarks.noisy_labels [--seeds 20] [--readings 50] [--rate 0.05]
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.spheres import make_map, random_readings, truth_of
from mapping import MapSettings, evaluate_map


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--readings", type=int, default=50)
    parser.add_argument("--rate", type=float, default=0.05)
    arguments = parser.parse_args()
    rate = arguments.rate
    settings = {
        "no noise": MapSettings(),
        "rates unknown": MapSettings(),
        "rates known": MapSettings(false_positive_rate=rate, false_negative_rate=rate),
    }
    scores = {name: [] for name in settings}
    with threadpool_limits(1):
        for seed in range(arguments.seeds):
            for name, chosen in settings.items():
                scores[name].append(
                    score(seed, arguments.readings, chosen, 0.0 if name == "no noise" else rate)
                )
    print("| map | AUPRC | log loss | Dice | seeds won on AUPRC | on log loss |\n|---|---|---|---|---|---|")
    known = scores["rates known"]
    for name, results in scores.items():
        means = [np.mean([getattr(r, key) for r in results]) for key in ("auprc", "log_loss", "dice")]
        wins = [
            sum(sign * (getattr(k, key) - getattr(r, key)) > 0 for k, r in zip(known, results, strict=True))
            for key, sign in (("auprc", 1), ("log_loss", -1))
        ]
        print(f"| {name} | {means[0]:.3f} | {means[1]:.4f} | {means[2]:.3f} | {wins[0]} | {wins[1]} |")


def score(seed: int, n_readings: int, settings: MapSettings, rate: float):
    flip_rng = np.random.default_rng([seed, 1])
    belief = make_map(settings)
    for points_m, is_occupied in random_readings(seed, n_readings):
        belief.update(points_m, is_occupied ^ (flip_rng.random(len(points_m)) < rate))
    return evaluate_map(belief.predict_lattice(), truth_of(seed, belief.query_points_m()))


if __name__ == "__main__":
    main()

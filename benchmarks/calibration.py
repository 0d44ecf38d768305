"""Is a probability of the map what it says? Reliability over many seeded truths with three hidden spheres.

    python -m benchmarks.calibration [--seeds 100] [--first 0] [--prevalence 0.02 0.5] [--variance 4 16]
        [--planner random] [--readings 50] [--figure docs/figures/calibration.png]

Points count when the map is in doubt, 0.02 < p < 0.98: a map that says 0 everywhere has none and fails. The
slope is that of a logistic regression of the truth on the map's log odds (1 is calibrated, above 1 too
timid), and the skill is 1 - log loss / log loss of the constant true prevalence, over all points.
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from benchmarks.spheres import map_by_expected_improvement, map_by_random, truth_of
from mapping import MapSettings, average_precision, dice, expected_calibration_error, log_loss

PLANNERS = {"random": map_by_random, "expected-improvement": map_by_expected_improvement}


@dataclass(frozen=True, eq=False)
class Answers:
    """Logits and truths of many maps, one row per seed."""

    logit: NDArray[np.float64]
    truth: NDArray[np.bool_]

    @property
    def probability(self) -> NDArray[np.float64]:
        return 1 / (1 + np.exp(-self.logit))

    @property
    def in_doubt(self) -> NDArray[np.bool_]:
        return (self.probability > 0.02) & (self.probability < 0.98)


def collect(planner: str, seeds: range, n_readings: int, settings: MapSettings) -> Answers:
    logits, truths = [], []
    for seed in seeds:
        belief = PLANNERS[planner](seed, n_readings, settings)
        logits.append(belief.predict_lattice().score)
        truths.append(truth_of(seed, belief.query_points_m()))
    return Answers(np.array(logits), np.array(truths))


def calibration_slope(logit: NDArray[np.float64], truth: NDArray[np.bool_]) -> float:
    def loss(line: NDArray[np.float64]) -> float:
        fitted = line[0] + line[1] * logit
        return float(np.mean(np.logaddexp(0, fitted) - truth * fitted))

    return float(minimize(loss, np.array([0.0, 1.0])).x[1])


def summary(answers: Answers) -> dict[str, float]:
    logit, truth, chosen = answers.logit, answers.truth, answers.in_doubt
    base = truth.mean()
    constant = log_loss(np.full(truth.size, np.log(base / (1 - base))), truth.ravel())
    return {
        "points in doubt": int(chosen.sum()),
        "calibration error": expected_calibration_error(answers.probability[chosen], truth[chosen]),
        "slope": calibration_slope(logit[chosen], truth[chosen]),
        "skill": 1 - log_loss(logit.ravel(), truth.ravel()) / constant,
        "AUPRC": float(np.mean([average_precision(*pair) for pair in zip(logit, truth, strict=True)])),
        "Dice": float(np.mean([dice(row > 0, true) for row, true in zip(logit, truth, strict=True)])),
    }


def draw_reliability(answers: dict[str, Answers], path: Path, n_bins: int = 15) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(4.5, 4.5), layout="constrained")
    axes.plot([0, 1], [0, 1], color="0.7", label="calibrated")
    for name, answer in answers.items():
        probability, truth = answer.probability[answer.in_doubt], answer.truth[answer.in_doubt]
        bins = np.array_split(np.argsort(probability), n_bins)
        axes.plot([probability[b].mean() for b in bins], [truth[b].mean() for b in bins], "o-", label=name)
    axes.set(xlabel="probability of the map", ylabel="share truly tumour", xlim=(0, 1), ylim=(0, 1))
    axes.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--readings", type=int, default=50)
    parser.add_argument("--prevalence", type=float, nargs="+", default=[MapSettings().prior_prevalence])
    parser.add_argument("--variance", type=float, nargs="+", default=[MapSettings().weight_variance])
    parser.add_argument("--planner", nargs="+", choices=PLANNERS, default=list(PLANNERS))
    parser.add_argument("--figure", type=Path, default=None)
    arguments = parser.parse_args()
    answers = {}
    print(
        "| planner | prior prevalence | weight variance | points in doubt | calibration error | slope | skill "
        "| AUPRC | Dice |\n|---|---|---|---|---|---|---|---|---|"
    )
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    with threadpool_limits(1):
        for planner, prevalence, variance in product(
            arguments.planner, arguments.prevalence, arguments.variance
        ):
            settings = MapSettings(prior_prevalence=prevalence, weight_variance=variance)
            answer = collect(planner, seeds, arguments.readings, settings)
            answers[f"{planner}, {prevalence:g}, {variance:g}"] = answer
            numbers = " | ".join(f"{value:.3g}" for value in summary(answer).values())
            print(f"| {planner} | {prevalence:g} | {variance:g} | {numbers} |", flush=True)
    if arguments.figure is not None:
        draw_reliability(answers, arguments.figure)


if __name__ == "__main__":
    main()

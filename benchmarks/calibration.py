"""Is a probability of the map what it says? Reliability over many seeded episodes of the scenario `spheres`.

    .venv/bin/python -m benchmarks.calibration [--seeds 100] [--first 0] [--prevalence 0.02 0.5] [--variance 4 10]
        [--gamma-spacing2 0.52 0.70] [--detail off on] [--planner random] [--readings 50]
        [--figure docs/figures/calibration.png]

A planner's episode without an arm gives the readings, and every setting of the map learns the same ones. Expected
improvement plans on the paper's map, since under a low prior it would stay at the first tumour.

Points inside the organ count when the map is in doubt, 0.02 < p < 0.98: a map that says 0 everywhere has none
and fails. The slope is that of a logistic regression of the truth on the map's log odds (1 is calibrated, above
1 too timid), and the skill is 1 - log loss / log loss of the constant true prevalence, over all points.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from mapping import (
    DetailedMap,
    DetailSettings,
    HilbertMap,
    MapSettings,
    average_precision,
    dice,
    expected_calibration_error,
    log_loss,
    make_hilbert_map,
)
from planner import make_planner
from sim.episode.episode import Episode
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import Setup, build_setup
from sim.world.sensing.reading import Reading

PLANNERS = ("random", "expected-improvement")


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


Choice = tuple[MapSettings, DetailSettings | None]


def collect(planner: str, seeds: range, n_readings: int, settings: list[Choice]) -> list[Answers]:
    """The answers of each setting, all from the same readings."""
    setup = build_setup(load_scenario("spheres"), None, MapSettings.paper())
    logits, truths = [[] for _ in settings], []
    for seed in seeds:
        chooser = make_planner(planner)
        episode = Episode(
            setup,
            chooser,
            seed=seed,
            map_settings=MapSettings.paper(),
            tumour_map=make_hilbert_map if chooser.needs_belief else None,
        )
        readings = [step.reading for step in episode.steps(n_readings)]
        truths.append(episode.truth.is_tumour)
        for of_setting, chosen in zip(logits, settings, strict=True):
            of_setting.append(learnt_logits(setup, *chosen, readings))
    return [Answers(np.array(of_setting), np.array(truths)) for of_setting in logits]


def learnt_logits(
    setup: Setup, settings: MapSettings, detail: DetailSettings | None, readings: list[Reading]
) -> NDArray[np.float64]:
    coarse = HilbertMap(
        setup.hinges, settings, query=setup.query, query_mask=setup.is_inside, hinge_mask=setup.hinge_mask
    )
    belief = coarse if detail is None else DetailedMap(coarse, detail)
    for reading in readings:
        belief.update(reading.points_m, reading.is_occupied)
    return belief.predict_lattice().score


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


def default_gamma_spacing2() -> float:
    return MapSettings().gamma_per_m2 * MapSettings().hinge_spacing_m ** 2


def parsed_arguments() -> Namespace:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--readings", type=int, default=50)
    parser.add_argument("--prevalence", type=float, nargs="+", default=[MapSettings().prior_prevalence])
    parser.add_argument("--variance", type=float, nargs="+", default=[MapSettings().weight_variance])
    parser.add_argument("--gamma-spacing2", type=float, nargs="+", default=[default_gamma_spacing2()])
    parser.add_argument("--detail", nargs="+", choices=("off", "on"), default=["off"])
    parser.add_argument("--planner", nargs="+", choices=PLANNERS, default=list(PLANNERS))
    parser.add_argument("--figure", type=Path, default=None)
    return parser.parse_args()


def setting(gamma_spacing2: float, prevalence: float, variance: float, detail: str) -> Choice:
    """The settings of a map, and of its detail where they are on."""
    settings = MapSettings(
        gamma_per_m2=gamma_spacing2 / MapSettings().hinge_spacing_m ** 2,
        prior_prevalence=prevalence,
        weight_variance=variance,
    )
    return settings, DetailSettings() if detail == "on" else None


def main() -> None:
    arguments = parsed_arguments()
    answers = {}
    print(
        "| planner | gamma spacing^2 | prior prevalence | weight variance | detail | points in doubt "
        "| calibration error | slope | skill | AUPRC | Dice |\n|---|---|---|---|---|---|---|---|---|---|---|"
    )
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    lists = (arguments.gamma_spacing2, arguments.prevalence, arguments.variance, arguments.detail)
    choices = list(product(*lists))
    settings = [setting(*choice) for choice in choices]
    with threadpool_limits(1):
        for planner in arguments.planner:
            found = collect(planner, seeds, arguments.readings, settings)
            for choice, answer in zip(choices, found, strict=True):
                names = [planner, *(f"{value:.3g}" for value in choice[:-1]), str(choice[-1])]
                answers[", ".join(names)] = answer
                numbers = [f"{value:.3g}" for value in summary(answer).values()]
                print(f"| {' | '.join(names + numbers)} |", flush=True)
    if arguments.figure is not None:
        draw_reliability(answers, arguments.figure)


if __name__ == "__main__":
    main()

"""What is left of the map when the organ is not where the plan says, with and without a belief about where it lies?

    .venv/bin/python -m benchmarks.body [--scenario liver] [--cases ideal registration ...] [--steps 30] [--seeds 8]
        [--first 0] [--ways none contacts readings] [--arm none] [--motion kinematic] [--jobs 2]
        [--out renders/body.jsonl] [--register-above-mm 3]

Each case but `ideal` runs twice on the same seeds: it believes the plan (`--register none`), or learns from contacts
(`--no-align-readings`). Where the tip is measured with an error it runs a third time, in which readings also tell how
they lie beside each other.
The error is the mean distance between where the tumours are believed to lie and where they do: medians over the seeds
after 10 actions and after all. `in 95 %` is the share of tumours that lay, after 10 actions, in the ellipsoid that the
belief states for 95 %. Calibration error and slope are those of the last map over the points in doubt, with
0.02 < p < 0.98, of all seeds together (`benchmarks.calibration`): a slope of 1 is calibrated, above 1 too timid. The
extra time is what an action computes beyond the ideal world's, planner, simulated world and
map together, in seconds of the process and not of the clock: the median of all actions of all seeds less that of the
ideal world, and, since readings are laid anew in fewer than half of the actions, the same of the means. Other work on
the machine makes both larger. The row of `ideal` has its own; without that case nothing is taken off. The file `--out`
keeps each episode as it ends, so that the table can be run in pieces: what is in the file is not run again. A change of
the code needs a new file.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from time import process_time
from typing import Any, Literal, get_args

import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.special import expit
from threadpoolctl import threadpool_limits

from benchmarks.calibration import calibration_slope
from mapping import expected_calibration_error
from sim.comparison.estimates import mean_estimate
from sim.comparison.texts import interval_text
from sim.episode.episode import Episode
from sim.episode.moving.motion import Motion
from sim.episode.setup import Setup, build_setup
from sim.findings.evidence import EpisodeWitness
from sim.findings.findings import find
from sim.running.config import EpisodeConfig
from sim.running.fields import changed
from sim.running.parts import EpisodeParts, make_parts
from sim.running.run_episode import make_episode
from sim.tables import markdown_table

from .kept_episodes import KeptEpisodes

CASES: dict[str, dict[str, Any]] = {
    "ideal": {},
    "registration": {"registration_mm": 12.0, "registration_deg": 5.0},
    "offset": {"registration_mm": 5.0},
    "scatter": {"tracking_mm": 3.0},
    "breathing": {"breathing_mm": 8.0},
    "pressed": {"tissue": "elastic", "press_n": 1.0},
    "pressed-3": {"tissue": "elastic", "press_n": 3.0},
    "together": {
        "registration_mm": 5.0, "registration_deg": 2.0, "tracking_mm": 1.0, "breathing_mm": 8.0, "gating": True,
        "tissue": "elastic",
    },
}  # fmt: skip
CASES["everything"] = CASES["together"] | {"sensor": "cone-with-errors", "reader": "published"}
"""What is wrong with the plan in each case."""
Way = Literal["none", "contacts", "readings"]
TOLD: dict[Way, str] = {"none": "the plan", "contacts": "contacts", "readings": "contacts and readings"}
Case = Literal[
    "ideal",
    "registration",
    "offset",
    "scatter",
    "breathing",
    "pressed",
    "pressed-3",
    "together",
    "everything",
]
Run = tuple[Case, str, int]
"""Case, way to register and seed of an episode."""
EARLY = 10
DOUBT = 0.02
"""A point is in doubt where its probability is farther than this from 0 and from 1."""
HEAD = (
    "what is wrong", "believed", "AUPRC", "sensed", "10 mm and more found", "false a run",
    f"error after {EARLY} [mm]", "at the end [mm]", "in 95 %", "calibration error / slope (points in doubt)",
    "extra time an action, median (mean) [ms]",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print a row for each case and each way to register."""

    scenario: str = "liver"
    cases: tuple[Case, ...] = get_args(Case)
    steps: int = 30
    seeds: int = 8
    first: int = 0
    """First seed."""
    ways: tuple[Way, ...] = get_args(Way)
    """What is believed: the plan, contacts alone, or contacts and how readings fit each other."""
    arm: str = "none"
    """Arm that carries the probe."""
    motion: Literal["kinematic", "servo"] = "kinematic"
    """How an arm moves: along its timed path, or by servos that press with a force, of which the largest error at the
    time of sensing is printed."""
    jobs: int = 2
    register_above_mm: float | None = None
    """Actions are spent on registering as long as the organ is believed to be off by more than this; None for never."""
    out: Path = Path("renders/body.jsonl")
    """File that keeps every episode."""


@lru_cache(maxsize=1)
def _setup(scenario: str, arm: str) -> Setup:
    parts = make_parts(changed(EpisodeConfig(), scenario=scenario, arm=arm))
    return build_setup(parts.scenario, parts.arm, parts.map_settings)


def _parts(options: Options, case: Case, register: str, seed: int) -> EpisodeParts:
    run: dict[str, Any] = {
        "scenario": options.scenario,
        "arm": options.arm,
        "steps": options.steps,
        "seed": seed,
    }
    run["motion"] = "none" if options.arm == "none" else options.motion
    if register != "none":
        run["register_above_mm"] = options.register_above_mm
        # Where the tip is measured exactly nothing aligns readings.
        run["align_readings"] = register == "readings" or "tracking_mm" not in CASES[case]
    run["register"] = "none" if register == "none" else "contacts"
    return make_parts(changed(EpisodeConfig(), **run, **CASES[case]))


def settings_of(run: Run, options: Options) -> dict[str, Any]:
    """The settings by which an episode is known in the file that keeps it."""
    case, register, seed = run
    kept = {
        "scenario": options.scenario,
        "steps": options.steps,
        "arm": options.arm,
        "motion": options.motion,
    }
    if register != "none" and options.register_above_mm is not None:
        kept["register_above_mm"] = options.register_above_mm
    return {"case": case, "register": register, "seed": seed, **kept, "wrong": CASES[case]}


def play(run: Run, *, options: Options) -> dict[str, Any]:
    """What became of one episode."""
    with threadpool_limits(1):
        parts = _parts(options, *run)
        episode = make_episode(parts, _setup(options.scenario, options.arm))
        witness, steps = EpisodeWitness(episode, parts.map_settings.prior_prevalence), []
        actions_s, began_s = [], process_time()
        for step in episode.steps(options.steps):
            actions_s.append(process_time() - began_s)
            witness.note()
            steps.append(step)
            began_s = process_time()
        findings = find(witness.evidence())
    early, last = steps[min(EARLY, len(steps)) - 1].body, steps[-1].body
    large = [each.is_found for each in findings.tumours if each.diameter_m >= 0.01]
    return {
        "auprc": steps[-1].auprc,
        "sensed": steps[-1].sensed_fraction,
        "found": (sum(map(bool, large)), len(large)),
        "false": len(findings.false),
        "early_mm": 0.0 if early is None else 1e3 * early.registration_error_m,
        "late_mm": 0.0 if last is None else 1e3 * last.registration_error_m,
        "inside": None if early is None else early.registration_within_share,
        "force_off": max((force_off(step.motion) for step in steps), default=0.0),
        "actions_s": actions_s,
        **in_doubt(episode),
    }


def in_doubt(episode: Episode) -> dict[str, list[float] | list[bool]]:
    """The log-odds of the last map at its points in doubt, and whether these are tumour."""
    assert episode.prediction is not None
    probability = episode.prediction.probability
    doubt = (probability > DOUBT) & (probability < 1.0 - DOUBT)
    log_odds = episode.prediction.score[doubt].round(5).tolist()
    return {"log_odds": log_odds, "is_tumour": episode.truth.is_tumour[doubt].tolist()}


def calibration_text(runs: list[dict[str, Any]]) -> str:
    """Calibration error and slope over the points in doubt of some episodes, and how many these are."""
    log_odds, is_tumour = (
        np.concatenate([each[name] for each in runs]) for name in ("log_odds", "is_tumour")
    )
    if not 0 < is_tumour.sum() < is_tumour.size:
        return "-"
    error = expected_calibration_error(expit(log_odds), is_tumour.astype(bool))
    slope = calibration_slope(log_odds, is_tumour.astype(bool))
    return f"{error:.3f} / {slope:.2f} ({log_odds.size:,})"


def force_off(motion: Motion) -> float:
    """By what share of the force that was wanted the force is off; 0 where none was."""
    if motion.force_error_n is None or motion.contact_force_n is None:
        return 0.0
    return abs(motion.force_error_n) / (motion.contact_force_n - motion.force_error_n)


def seconds(runs: list[dict[str, Any]]) -> NDArray[np.float64]:
    """Median and mean of what an action of some episodes computes [s], shape (2,)."""
    actions_s = np.concatenate([each["actions_s"] for each in runs])
    return np.array([np.median(actions_s), np.mean(actions_s)], dtype=np.float64)


def row(case: Case, register: Way, runs: list[dict[str, Any]], ideal_s: NDArray[np.float64]) -> list[str]:
    """The figures of some episodes."""
    auprc = mean_estimate(np.array([each["auprc"] for each in runs]))
    found, n = np.sum([each["found"] for each in runs], axis=0)
    inside = [each["inside"] for each in runs if each["inside"] is not None]
    sign = "" if case == "ideal" else "+"
    median_ms, mean_ms = 1e3 * (seconds(runs) - ideal_s)
    return [
        case,
        TOLD[register] if case != "ideal" else "-",
        f"{auprc.mean:.3f} {interval_text(auprc.interval, '{:.3f}')}",
        f"{np.mean([each['sensed'] for each in runs]):.3f}",
        f"{found} of {n}",
        f"{np.mean([each['false'] for each in runs]):.2f}",
        f"{np.median([each['early_mm'] for each in runs]):.2f}",
        f"{np.median([each['late_mm'] for each in runs]):.2f}",
        f"{np.mean(inside):.2f}" if inside else "-",
        calibration_text(runs),
        f"{median_ms:{sign}.0f} ({mean_ms:{sign}.0f})",
    ]


def ways_of(case: Case, options: Options) -> list[Way]:
    """What is believed in a case, one after the other: readings tell nothing where the tip is measured exactly."""
    if case == "ideal":
        return ["none"]
    return [way for way in options.ways if way != "readings" or "tracking_mm" in CASES[case]]


def main(options: Options) -> None:
    """Run the episodes that the file lacks, and print the table."""
    ways: list[tuple[Case, Way]] = [(c, r) for c in options.cases for r in ways_of(c, options)]
    seeds = range(options.first, options.first + options.seeds)
    rows, ideal_s = [], np.zeros(2)
    known_by, work = partial(settings_of, options=options), partial(play, options=options)
    with KeptEpisodes[Run](options.out, work, known_by, n_jobs=options.jobs) as kept:
        for case, register in ways:
            runs = kept.rows([(case, register, seed) for seed in seeds], f"{case} {register}")
            rows.append(row(case, register, runs, ideal_s))
            if options.motion == "servo":
                print(f"force off by at most {max(each['force_off'] for each in runs):.2%}")
            if case == "ideal":
                ideal_s = seconds(runs)
            print(" | ".join(rows[-1]), flush=True)
    print(markdown_table(HEAD, rows))


if __name__ == "__main__":
    # Worker processes find functions by the name of their module, which is not `__main__` there.
    from benchmarks import body

    body.main(tyro.cli(body.Options, description=__doc__))

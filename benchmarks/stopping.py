"""When the default planner stops, and whether what it states is true: `.venv/bin/python -m benchmarks.stopping`.

On the paper's organ, with a free probe and a cone of 80 mm, so that a part of the organ lies beyond its reach. Lesions
are balls. As many as in the patients of LiTS are planted, of their sizes and even in place (`as expected`); or as many,
but of 8 to 10 mm diameter and where few poses could find them (`small, hard places`), for which the planner is told
nothing, or their size. Each episode is stopped by confidence or by cost; at every tenth action of the former is kept
what the planner states and what is true. A lesion counts as missed if no reading had a label in it. The map's hinges
are 18 mm apart in place of 11.25, which makes an action half as dear. The file `--out` keeps each episode as it ends,
so the benchmark, called again, goes on where it was stopped. A change of the code needs a new file.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from mapping import DetailSettings, MapSettings
from planner import FindAndOutline, LesionPrior
from sim.comparison.estimates import mean_estimate, share_interval
from sim.comparison.tables import interval_text
from sim.episode.episode import Episode
from sim.tables import markdown_table
from sim.world.anatomy.tumour_shapes import ball_shape
from sim.world.solids.solid import Solid

from .kept_episodes import KeptEpisodes
from .planted_lesions import EXPECTED, HARD, HINGES_M, n_finders, planted, setup_of

TOLD = LesionPrior(median_diameter_m=0.009, diameter_spread=0.065)
"""The sizes of the small lesions, where the planner is told them."""
CASES: dict[str, tuple[str, LesionPrior]] = {
    EXPECTED: (EXPECTED, LesionPrior()),
    HARD: (HARD, LesionPrior()),
    "the same, size told": (HARD, TOLD),
}
"""Which lesions are planted, and which are expected."""
RULES = ("confidence", "cost")
Job = tuple[str, str, int]
"""Case, rule and seed of an episode."""
EVERY = 10
"""What is stated is kept after each of so many actions."""
SMALL_RADIUS_M = 0.004
"""The confidence is also asked about tumours of this radius [m]; the rule goes by 8 mm."""
BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
"""Stated probabilities are put together within these."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run every case on some seeds, and print the tables."""

    first: int = 2000
    """First seed."""
    seeds: int = 200
    """Number of seeds of small lesions in hard places with nothing told, the case that is meant to fail."""
    few_seeds: int = 40
    """Number of seeds of the other cases."""
    cases: tuple[str, ...] = tuple(CASES)
    """Cases that are run."""
    rules: tuple[str, ...] = RULES
    """Rules by which they are stopped."""
    steps: int = 150
    """Largest number of sensing actions."""
    confidence: float = 0.95
    """Confidence at which an episode ends."""
    miss_cost: float = 100.0
    """How many actions a missed lesion is worth."""
    jobs: int = 1
    """Number of processes."""
    out: Path = Path("renders/stopping.jsonl")
    """File that keeps every episode."""


def play(job: Job, *, options: Options) -> dict[str, Any]:
    """An episode: actions, how it ended, what was missed, and what was stated on the way."""
    case, rule, seed = job
    kind, prior = CASES[case]
    setup, (unit_m, faces) = setup_of(), ball_shape()
    balls = planted(setup, kind, np.random.default_rng((seed, 1)))
    bodies = tuple(Solid(centre_m + radius_m * unit_m, faces) for centre_m, radius_m in balls)
    is_findable = np.array([n_finders(setup, *ball) > 0 for ball in balls], dtype=bool)
    planner, stated = FindAndOutline(lesions=prior), []
    with threadpool_limits(limits=1):
        episode = Episode(
            replace(setup, given_tumours=bodies, tumour_names=()),
            planner,
            seed=seed,
            map_settings=MapSettings(hinge_spacing_m=HINGES_M),
            detail=DetailSettings(),
        )
        is_sure = rule == "confidence"
        steps = episode.steps(
            options.steps,
            until_confident=options.confidence if is_sure else None,
            miss_cost=None if is_sure else options.miss_cost,
        )
        is_found, n_steps = np.zeros(len(balls), dtype=bool), 0
        for step in steps:
            labels_m = step.reading.points_m[step.reading.is_occupied]
            is_found |= np.array([body.contains(labels_m).any() for body in bodies], dtype=bool)
            n_steps = step.step
            if is_sure and n_steps % EVERY == 0:
                stated.append(statement(episode, planner, is_found, is_findable))
        left = planner.what_is_left(episode.situation())
    return {
        "n": len(balls),
        "n_findable": int(is_findable.sum()),
        "n_steps": n_steps,
        "ended_by": episode.ended_by,
        "n_missed": int((is_findable & ~is_found).sum()),
        "n_unseen": int((~is_findable & ~is_found).sum()),
        "n_touched": int(is_found.sum()),
        "n_counted": left.n_found,
        "unseeable_share": left.unseeable_share,
        "stated": stated,
    }


def statement(
    episode: Episode, planner: FindAndOutline, is_found: NDArray[np.bool_], is_findable: NDArray[np.bool_]
) -> dict[str, float]:
    """What the planner states now, and what is true."""
    situation = episode.situation()
    left = planner.what_is_left(situation)
    # Nothing is worth outlining here, so that the confidence is told also before all is outlined.
    small = replace(planner, sure_radius_m=SMALL_RADIUS_M, least_gain_m3=1.0)
    return {
        "expected": left.expected_left,
        "none": left.chance_of_none,
        "expected_unseeable": left.expected_unseeable,
        "confidence": small.confidence(situation),
        "counted": left.n_found,
        "touched": int(is_found.sum()),
        "left": int((is_findable & ~is_found).sum()),
        "unseen": int((~is_findable & ~is_found).sum()),
    }


def settings_of(job: Job, options: Options) -> dict[str, Any]:
    """The settings by which an episode is known."""
    case, rule, seed = job
    limits = {"steps": options.steps, "confidence": options.confidence, "miss_cost": options.miss_cost}
    return {"case": case, "rule": rule, "seed": seed, **limits}


def jobs_of(options: Options) -> list[Job]:
    """All episodes; the confidence does not go by what is expected, so that it runs where nothing is told."""
    n_seeds = {case: options.seeds if case == HARD else options.few_seeds for case in CASES}
    return [
        (case, rule, seed)
        for seed in range(options.first, options.first + max(n_seeds.values()))
        for case, (_, prior) in CASES.items()
        for rule in RULES
        if case in options.cases and rule in options.rules
        if seed < options.first + n_seeds[case] and (rule == "cost" or prior == LesionPrior())
    ]


def mean_text(values: list[float], form: str = "{:.2f}") -> str:
    """The mean of some values, with its interval."""
    estimate = mean_estimate(np.array(values, dtype=float))
    return f"{form.format(estimate.mean)} {interval_text(estimate.interval, form)}"


def stop_table(rows: dict[tuple[str, str], list[dict[str, Any]]], options: Options) -> str:
    """Actions, what was missed and the cost, by case and rule."""
    head = ("case", "rule", "seeds", "actions", "limit", "findable", "missed", "beyond reach", "cost")
    lines = []
    for (case, rule), some in rows.items():
        lines.append([
            case,
            rule,
            str(len(some)),
            mean_text([row["n_steps"] for row in some], "{:.0f}"),
            str(sum(row["ended_by"] == "steps" for row in some)),
            f"{np.mean([row['n_findable'] for row in some]):.2f}",
            mean_text([row["n_missed"] for row in some]),
            f"{np.mean([row['n_unseen'] for row in some]):.2f}",
            mean_text([row["n_steps"] + options.miss_cost * row["n_missed"] for row in some], "{:.0f}"),
        ])  # fmt: skip
    return markdown_table(head, lines)


def fixed_table(some: list[dict[str, Any]], miss_cost: float) -> str:
    """What episodes cost that end after a number of actions that was fixed before, and such as end when it is best.

    Later than an episode of the rule by confidence went on, as little is missed as at its end.
    """
    some = [row for row in some if row["stated"]]
    ends = range(EVERY, EVERY * max(len(row["stated"]) for row in some) + 1, EVERY)
    missed = np.array([
        [row["stated"][min(end // EVERY, len(row["stated"])) - 1]["left"] for end in ends] for row in some
    ])  # fmt: skip
    cost = np.array(ends) + miss_cost * missed
    lines = [
        [str(end), mean_text([*missed[:, i]]), mean_text([*cost[:, i]], "{:.0f}")]
        for i, end in enumerate(ends)
    ]
    best = np.array(ends)[cost.argmin(axis=1)]
    lines.append([f"{best.mean():.0f}, each its best", "", mean_text([*cost.min(axis=1)], "{:.0f}")])
    return markdown_table(("actions", "missed", "cost"), lines)


def calibration_table(some: list[dict[str, Any]], key: str) -> str:
    """What was stated at every tenth action against what was true, by the stated probability that none is left."""
    stated = [each for row in some for each in row["stated"]]
    head = ("stated", "statements", "mean", "true", "expected left", "truly left")
    lines = []
    for low, high in itertools.pairwise(BINS):
        within = [each for each in stated if low <= each[key] < high or each[key] == high == 1.0]
        if within:
            lines.append([
                f"{low:g} to {high:g}",
                str(len(within)),
                f"{np.mean([each[key] for each in within]):.3f}",
                none_text(within, len(some)),
                f"{np.mean([each['expected'] for each in within]):.2f}",
                f"{np.mean([each['left'] for each in within]):.2f}",
            ])  # fmt: skip
    return markdown_table(head, lines)


def none_text(some: list[dict[str, Any]], n_seeds: int) -> str:
    """The share of statements at which none was left, with Wilson's interval for as many seeds, at most."""
    share = float(np.mean([each["left"] == 0 for each in some]))
    return f"{share:.3f} {interval_text(share_interval(share, min(len(some), n_seeds)), '{:.2f}')}"


def count_text(some: list[dict[str, Any]]) -> str:
    """How often the count of lesions is that of the lesions touched, at every tenth action from the thirtieth on."""
    late = [each for row in some for each in row["stated"][2:] if each["touched"]]
    over = np.mean([each["counted"] > each["touched"] for each in late])
    under = np.mean([each["counted"] < each["touched"] for each in late])
    ratio = sum(each["counted"] for each in late) / max(sum(each["touched"] for each in late), 1)
    last = [row["stated"][-1] for row in some if row["stated"]]
    beyond, unseen = (np.mean([each[key] for each in last]) for key in ("expected_unseeable", "unseen"))
    return (
        f"counted {ratio:.2f} of the lesions touched; too many in {over:.1%} and too few in {under:.1%} of {len(late)} "
        f"statements; {np.mean([row['unseeable_share'] for row in some]):.1%} of what is expected is out of sight: "
        f"{beyond:.2f} lesions in the last statement, truly {unseen:.2f}"
    )


def main(options: Options) -> None:
    """Run the cases and print the tables."""
    rows: dict[tuple[str, str], list[dict[str, Any]]] = {}
    jobs, known_by, work = (
        jobs_of(options),
        partial(settings_of, options=options),
        partial(play, options=options),
    )
    with KeptEpisodes[Job](options.out, work, known_by, n_jobs=options.jobs) as kept:
        for (case, rule, _), row in zip(jobs, kept.rows(jobs), strict=True):
            rows.setdefault((case, rule), []).append(row)
    print(stop_table(rows, options))
    for (case, rule), some in rows.items():
        if rule == "confidence":
            print(f"\n{case}: {count_text(some)}\n\nP(none left)\n{calibration_table(some, 'none')}")
            print(f"\nC^(k+1) for radii of 4 mm\n{calibration_table(some, 'confidence')}")
            print(f"\nEnding after a number of actions\n{fixed_table(some, options.miss_cost)}")


if __name__ == "__main__":
    # Worker processes find functions by the name of their module, which is not `__main__` there.
    from benchmarks import stopping

    stopping.main(tyro.cli(stopping.Options))

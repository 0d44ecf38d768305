"""A comparison as tables: Markdown for people, CSV for programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from sim.tables import markdown_table

from .comparison import SENSINGS, Comparison, Pairing, Score
from .estimates import Interval, MeanEstimate

SCORE_HEAD = ("contender", "trials", "mean ± sd", "95 % interval", "median [95 %]", "never", "failed")
PAIR_HEAD = ("pair", "seeds", "mean difference [95 %]", "wins / ties / losses", "win rate [95 %]")


def markdown(comparison: Comparison, notes: Sequence[str] = ()) -> str:
    """All tables, case by case."""
    parts = ["# Comparison", *notes]
    for case in comparison.cases:
        parts += [f"## {case}", *failures(comparison, case)]
        scores = [score for score in comparison.scores if score.case == case]
        pairings = [pairing for pairing in comparison.pairings if pairing.case == case]
        for measure in dict.fromkeys(score.measure for score in scores):
            better = "lower" if measure.lower_is_better else "higher"
            parts.append(f"### {measure.label} ({better} is better)")
            mine = [score for score in scores if score.measure == measure]
            parts.append(score_table(mine))
            if math.isfinite(mine[0].horizon):
                parts.append(
                    f"Not every trial got there. Means are restricted to {mine[0].horizon:.0f} actions: a trial that "
                    "needs more, or never gets there, counts with that number. Medians are of all trials."
                )
            pairs = [pairing for pairing in pairings if pairing.measure == measure]
            if pairs:
                parts.append(pair_table(pairs))
    return "\n\n".join(parts) + "\n"


def score_table(scores: Sequence[Score]) -> str:
    """Scores by one measure as a Markdown table."""
    rows = []
    for score in scores:
        form, estimate = score.measure.form, score.estimate
        never = f"{score.n_never} of {estimate.n}" if score.measure is SENSINGS else "–"
        rows.append(
            (
                score.contender,
                str(estimate.n),
                f"{form.format(estimate.mean)} ± {number_text(estimate.deviation, form)}",
                interval_text(estimate.interval, form),
                f"{number_text(score.median, form)} {interval_text(score.median_interval, form)}",
                never,
                str(score.n_failed),
            )
        )
    return markdown_table(SCORE_HEAD, rows)


def pair_table(pairings: Sequence[Pairing]) -> str:
    """Pairings by one measure as a Markdown table; differences are first minus second."""
    rows = []
    for pairing in pairings:
        form, estimate = pairing.measure.form, pairing.estimate
        difference = estimate.difference
        n_losses = estimate.n - estimate.n_wins - estimate.n_ties
        rows.append(
            (
                f"{pairing.first} − {pairing.second}",
                str(estimate.n),
                f"{form.format(difference.mean)} {interval_text(difference.interval, form)}",
                f"{estimate.n_wins} / {estimate.n_ties} / {n_losses}",
                f"{estimate.win_rate:.0%} {interval_text(estimate.win_interval, '{:.0%}')}",
            )
        )
    return markdown_table(PAIR_HEAD, rows)


def interval_text(interval: Interval, form: str) -> str:
    """An interval in brackets, a dash where there is none."""
    if math.isnan(interval[0]):
        return "[–]"
    return f"[{number_text(interval[0], form)}, {number_text(interval[1], form)}]"


def flat_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Scores and pairings as rows of one CSV file, with all their digits."""
    return [*map(_score_row, comparison.scores), *map(_pairing_row, comparison.pairings)]


def _score_row(score: Score) -> dict[str, Any]:
    return {
        "case": score.case,
        "measure": score.measure.key,
        "contender": score.contender,
        "against": "",
        **_estimate_cells(score.estimate),
        "median": score.median,
        "median_low": score.median_interval[0],
        "median_high": score.median_interval[1],
        "horizon": score.horizon,
        "n_never": score.n_never,
        "n_failed": score.n_failed,
    }


def _pairing_row(pairing: Pairing) -> dict[str, Any]:
    estimate = pairing.estimate
    return {
        "case": pairing.case,
        "measure": pairing.measure.key,
        "contender": pairing.first,
        "against": pairing.second,
        **_estimate_cells(estimate.difference),
        "n_wins": estimate.n_wins,
        "n_ties": estimate.n_ties,
        "win_rate": estimate.win_rate,
        "win_low": estimate.win_interval[0],
        "win_high": estimate.win_interval[1],
    }


def _estimate_cells(estimate: MeanEstimate) -> dict[str, Any]:
    return {
        "n": estimate.n,
        "mean": estimate.mean,
        "deviation": estimate.deviation,
        "low": estimate.interval[0],
        "high": estimate.interval[1],
    }


def failures(comparison: Comparison, case: str) -> list[str]:
    """A sentence about the trials without a result, which must not go unnoticed."""
    failed = [(group, entry) for group in comparison.groups_of(case) for entry in group.failed]
    if not failed:
        return []
    group, entry = failed[0]
    return [
        f"{len(failed)} trials of this case have no result and are left out, the first being {group.contender}, seed "
        f"{entry['settings']['seed']}: {entry['row']['error']}"
    ]


def number_text(value: float, form: str) -> str:
    """A number, a dash where there is none, `never` where it is infinite."""
    if math.isnan(value):
        return "–"
    return "never" if math.isinf(value) else form.format(value)
